"""Ten machines with something that no list holds: neither an effect of the catalogue nor a
class of terms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .kernels import drag
from .nominal import Effect, Physics
from .plant import Plant
from .programmes import Drive

Floats = npt.NDArray[np.float64]

# What each does, and which names of the catalogue are a fair answer to it.
MACHINES: dict[str, tuple[str, ...]] = {
    # the hopper shakes near one shaft speed, and more flows
    "resonance": (),
    "warm_grease": (),  # the shaft is held back until its grease is warm
    # a play that grows with the way that the gate has gone
    "creeping_play": ("gate.backlash",),
    # the shaft slows down more slowly than it speeds up
    "asymmetric_rate": ("shaft.ramp",),
    # what flows wanders with a weather that nobody recorded
    "humidity": ("flow.moisture_drift",),
    # the cell gives way for minutes after its load has changed
    "load_cell_creep": ("scale.drift",),
    "latency_by_speed": ("shaft.dead_time",),  # a slow shaft answers later than a quick one
    # pulses of the shaft beat with the rows of the log
    "aliasing": (),
    "coarse_gate": (),  # the gate stands at every second millimetre only
    "two_dimensions": (),  # filling depends on speed and opening together
}
FALL_RPM_S, STEP_MM, PLAY_MM, PLAY_TRAVEL_MM = 12.0, 2.0, 3.0, 400.0
GREASE_S, CREEP_S, WEATHER_S = 240.0, 200.0, 150.0
PULSES = 7.3  # a turn


class Unlisted(Plant):
    """A machine of MACHINES, and nothing else of note."""

    def __init__(self, drive: Drive, machine: str, seed: int) -> None:
        super().__init__(drive)
        self.machine, self.seed = machine, seed

    def _gate(self, p: Physics, effects: tuple[Effect, ...]) -> Floats:
        opening = super()._gate(p, effects)
        if self.machine == "creeping_play":
            way = np.cumsum(np.abs(np.diff(opening, prepend=opening[0])))
            return drag(
                opening, 0.5 * PLAY_MM * -np.expm1(-way / PLAY_TRAVEL_MM), float(opening[0])
            )
        return np.round(opening / STEP_MM) * STEP_MM if self.machine == "coarse_gate" else opening

    def _shaft(self, p: Physics, effects: tuple[Effect, ...], opening: Floats) -> Floats:
        rpm, since_s = super()._shaft(p, effects, opening), self.fine_s - self.fine_s[0]
        if self.machine == "warm_grease":
            return np.asarray(rpm * (1.0 - 0.08 * np.exp(-since_s / GREASE_S)))
        if self.machine == "asymmetric_rate":
            slow, most = rpm.copy(), FALL_RPM_S * self.dt_s
            for k in range(1, slow.size):
                slow[k] = max(rpm[k], slow[k - 1] - most)
            return slow
        if self.machine == "latency_by_speed":
            return np.interp(self.fine_s - 0.5 * 20.0 / np.maximum(rpm, 10.0), self.fine_s, rpm)
        return rpm

    def _shaft_reading(self, shaft: Floats, effects: tuple[Effect, ...]) -> Floats:
        read = super()._shaft_reading(shaft, effects)
        if self.machine != "aliasing":
            return read
        turns = self._at_rows(np.cumsum(shaft) * self.dt_s / 60.0)
        return np.asarray(read * (1.0 + 0.03 * np.sin(2.0 * np.pi * PULSES * turns)))

    def _flow(
        self, p: Physics, effects: tuple[Effect, ...], shaft: Floats, opening: Floats
    ) -> Floats:
        flow = super()._flow(p, effects, shaft, opening)
        if self.machine == "resonance":
            flow = flow * (1.0 + 0.12 / (1.0 + ((shaft - 52.0) / 6.0) ** 2))
        elif self.machine == "humidity":
            rng = np.random.default_rng([self.seed, 8])
            at = (self.fine_s - self.fine_s[0]) / WEATHER_S
            days = rng.normal(size=int(at[-1]) + 2)
            flow = flow * (1.0 + 0.05 * np.interp(at, np.arange(len(days)), days))
        elif self.machine == "two_dimensions":
            flow = flow * (
                1.0 + 0.12 * np.tanh((shaft - 50.0) / 20.0) * np.tanh((opening - 30.0) / 12.0)
            )
        return np.asarray(flow)

    def _scale(self, p: Physics, effects: tuple[Effect, ...], flow: Floats) -> Floats:
        reading = super()._scale(p, effects, flow)
        if self.machine != "load_cell_creep":
            return reading
        late, share = reading.copy(), -np.expm1(-self.drive.row_s / CREEP_S)
        for k in range(1, late.size):
            late[k] = late[k - 1] + share * (reading[k] - late[k - 1])
        return np.asarray(reading + 0.03 * (late - reading))

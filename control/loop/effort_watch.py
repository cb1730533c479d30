"""Does the metering drive work as hard as it should? What a loop that holds its speed hides.
Pure."""

from __future__ import annotations

from math import hypot, inf

from topdress.control.log_row import HOLDS_S
from topdress.control.machine.effort import EffortInput, shaft_parts, supply_factor
from topdress.control.machine.flow import in_flutes
from topdress.control.machine.machine import Machine
from topdress.control.metering.inverse import Conditions
from topdress.control.readings import NO_EFFORT, EffortSays, Measurements, held

# of a first-order mean: 96 % of a step within the 10 s in which it is to be said
MEAN_S = 3.0
# of the mean that a drive is held against: its own error adds 0.5 % to the noise
USUAL_S = 100.0 * MEAN_S
# of turning, before that mean is believed: its own error adds a tenth
SETTLES_S = 10.0 * MEAN_S
# Of what the machine file's tolerance leaves open, which is how sound drives differ from run to
# run (1.8 to 3.5 %: Cranfield's ball screw): one sound drive of 740 is beyond it, until a
# reference of its own is taken.
LEAST_SD = 3.0
# Of the mean, by the machine file's noise of a reading (`calibrate effort` has it from what a
# sound run is off its fit): chance alone is beyond it, on either side, after MEAN_S sqrt(2 pi)
# exp(NOISE_SD^2 / 2) / NOISE_SD of turning on the mean (first passage of a first-order process:
# Siegert, Phys. Rev. 81, 1951, 617): 23,000 h, a season has some 300.
NOISE_SD = 6.0
# of the bounds, within which what was said is over: at one bound noise would flicker
HOLDS = 0.5
# of turning within them, until it is over
BACK_S = 5.0 * MEAN_S
# that a duty cycle grows by where an unmeasured supply falls as the engine idles
SUPPLY_SHARE = 1.2 / 12.3
# of the material's load: as near to none of it as to all, so that either error is as likely
LOAD_SHARE = 0.5


class EffortWatch:
    """`says`: what the drive's effort says, now. Once a tick `update`.

    What begins at once is held against what this drive did in the last minutes; what was there
    all along, against the machine file and its tolerances.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine, self._tells = machine, machine.has("effort")
        self._off: float | None = None  # measured less expected
        # the same as a share, for minutes; for how long it was known
        self._usual = self._turned_s = 0.0
        self._back_s = 0.0  # within its bounds, though something was said
        # the same as `_usual`, where it was last judged
        self._said_share = 0.0
        self._rests = NO_EFFORT._replace(unit=machine.effort_unit if self._tells else "")
        self.says = self._rests

    def update(self, m: Measurements, c: Conditions, dt_s: float, turns: bool) -> None:
        """turns : material is to flow by a turning shaft; else nothing is judged."""
        effort, rpm, opening_mm = (
            held(read, m.time_s, HOLDS_S["shaft_effort"]) if self._tells and turns else None
            for read in (m.shaft_effort, m.shaft_rpm, m.opening_mm)
        )
        if effort is None or rpm is None or opening_mm is None or not rpm > 0.0:
            # what was said holds until it turns again, and is judged from there on
            self._off, self.says = (
                None,
                self._rests._replace(
                    harder_percent=self.says.harder_percent, unloaded=self.says.unloaded
                ),
            )
            return
        machine, own = self._machine, self._machine.effort
        u = effort_input(machine, rpm, opening_mm, c)
        supply = supply_factor(own, u)
        friction, drag, _gains, load = (supply * part for part in shaft_parts(own, u))
        should = max(0.0, friction + drag + load)
        share = min(1.0, dt_s / MEAN_S)
        usual = self._said_share if self.says.harder_percent or self.says.unloaded else self._usual
        before = usual * should if self._off is None else self._off
        off = self._off = before + share * (abs(effort) - should - before)
        self._turned_s += dt_s
        usual = self._usual * should
        chance = NOISE_SD * machine.noise.effort * (0.5 * share) ** 0.5
        unknown = own.by_supply * SUPPLY_SHARE * should if c.supply_v is None else 0.0
        keeps = HOLDS if self.says.harder_percent or self.says.unloaded else 1.0
        sudden = keeps * max(LOAD_SHARE * load, chance, unknown)
        # what a sound drive's parts, each within its tolerance (1 s.d.), and its supply leave
        # open of its effort
        sd = hypot(
            0.01 * machine.tolerance.effort_percent * hypot(friction, drag, load), 0.5 * unknown
        )
        far = max(sudden, keeps * LEAST_SD * sd)
        more, less = (usual + sudden, usual - sudden) if self._turned_s > SETTLES_S else (inf, -inf)
        more, less = min(far, more), max(-far, less) if load > chance else -should
        high, low = off > more, off < less
        # as the shaft runs down at a pass's end, hardly anything shows
        self._back_s = 0.0 if high or low or keeps == 1.0 else self._back_s + dt_s
        harder_percent = 100.0 * max(off, off - usual) / max(should, 1e-9) if high else 0.0
        if 0.0 < self._back_s < BACK_S:
            harder_percent, low = self.says.harder_percent, self.says.unloaded
            high = harder_percent > 0.0
        self.says = EffortSays(
            harder_percent,
            low,
            should + off,
            should,
            max(0.0, should + less),
            should + more,
            machine.effort_unit,
        )
        self._said_share = off / max(should, 1e-9)
        if not (high or low):
            self._usual += min(1.0, dt_s / min(USUAL_S, self._turned_s)) * (
                off / max(should, 1e-9) - self._usual
            )


def effort_input(machine: Machine, rpm: float, opening_mm: float, c: Conditions) -> EffortInput:
    """What the metering drive's effort depends on, at a steady speed."""
    full = 1.0 if c.hopper_kg is None else c.hopper_kg / machine.flow.full_kg
    nominal_v = machine.shaft.nominal_supply_v
    return EffortInput(
        rpm,
        0.0,
        nominal_v / max(1.0, nominal_v if c.supply_v is None else c.supply_v),
        *in_flutes(
            machine.flow,
            rpm,
            max(0.0, opening_mm - machine.gate.offset_mm),
            c.pitch_deg,
            full,
            c.elapsed_s,
            0.0,
            c.refilled,
        ),
    )

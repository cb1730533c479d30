"""How does a virtual lag rig work? It runs the rig's own program, with the plant's shaft as encoder
and the plant's granules on the plate.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable

from topdress.control.simulation.plant import PlantTruth, SensorReadings
from topdress.drivers.board.lag_rig import RigPins, RigProgram, RigSettings
from topdress.drivers.ports import Port
from topdress.drivers.virtual.virtual_devices import MachineExtra

# Rounds of the rig's program in one step of the plant.
ROUNDS_PER_STEP = 10
# Reading of the plate's sensor without a granule, in counts of the converter.
RESTING_PLATE_COUNTS = 500
# Rise of that reading by one granule, in counts of the converter.
GRANULE_COUNTS = 80
# Flow below which no granule leaves the outlet, kg/s.
MIN_FLOW_KG_S = 1e-4
# Lower limit of a drop time, s, which prevents a division by zero.
MIN_DROP_S = 1e-6


class _Pins(RigPins):
    def __init__(self, port: Port) -> None:
        self._port = port
        self.turns = 0.0
        self.counts = self.newest_us = self.before_us = 0
        self.value = RESTING_PLATE_COUNTS

    def read(self) -> bytes:
        return self._port.read()

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def encoder(self) -> tuple[int, int, int]:
        return self.counts, self.newest_us, self.before_us

    def plate(self) -> int:
        return self.value


class VirtualLagRig(MachineExtra):
    """Adds a lag rig to the virtual machine. `truth` returns the real state of the plant after the
    newest step."""

    def __init__(self, port: Port, truth: Callable[[], PlantTruth | None]) -> None:
        self._pins = _Pins(port)
        self._settings = RigSettings()
        self._program = RigProgram(self._pins, self._settings)
        self._truth = truth
        # For each granule: covered share of the way, its own pace (1/s), and its additional time,
        # s.
        self._falling: list[list[float]] = []
        # Landing times on the plant's clock, s, as a heap.
        self._landing: list[float] = []
        self._rounds = 0
        self._last_s = 0.0
        self._rpm = 0.0

    def take_readings(self, sensed: SensorReadings, begin_s: float) -> None:
        """Advances the granules and the rig's program by one step."""
        truth = self._truth()
        if truth is None:
            return
        if truth.flow_kg_s > MIN_FLOW_KG_S:
            pace = 1.0 / max(truth.settled_drop_s, MIN_DROP_S)
            self._falling.append([0.0, pace, truth.drop_s - truth.settled_drop_s])
        self._carry_granules(truth)
        step_s, from_rpm = truth.time_s - self._last_s, self._rpm
        for part in range(1, ROUNDS_PER_STEP + 1):
            share = part / ROUNDS_PER_STEP
            self._run_program_round(
                self._last_s + share * step_s,
                from_rpm + share * (truth.shaft_rpm - from_rpm),
                step_s / ROUNDS_PER_STEP,
            )
        self._last_s, self._rpm = truth.time_s, truth.shaft_rpm

    def _carry_granules(self, truth: PlantTruth) -> None:
        """Advances falling granules by a step, as `control.machine.landing.falls_s` does."""
        step_s, share = truth.time_s - self._last_s, truth.carried_share
        stream = share / max(truth.settled_drop_s, MIN_DROP_S)
        still: list[list[float]] = []
        for granule in self._falling:
            pace = stream + (1.0 - share) * granule[1]
            if granule[0] + pace * step_s < 1.0:
                granule[0] += pace * step_s
                still.append(granule)
            else:
                heapq.heappush(self._landing, self._last_s + (1.0 - granule[0]) / pace + granule[2])
        self._falling = still

    def _run_program_round(self, now_s: float, rpm: float, dt_s: float) -> None:
        pins = self._pins
        pins.turns += rpm / 60.0 * dt_s
        counts = int(pins.turns * self._settings.counts_per_turn)
        if counts > pins.counts:
            between_us = round(60e6 / (rpm * self._settings.counts_per_turn)) if rpm > 0.0 else 0
            pins.before_us = round(now_s * 1e6) - between_us
            pins.counts, pins.newest_us = counts, round(now_s * 1e6)
        landed = False
        while self._landing and self._landing[0] <= now_s:
            # A small ripple replaces the noise of a real sensor, so that the rig's threshold is
            # tested.
            heapq.heappop(self._landing)
            landed = True
        self._rounds += 1
        pins.value = RESTING_PLATE_COUNTS + GRANULE_COUNTS * landed + self._rounds * 7 % 5
        self._program.run_round(round(now_s * 1e6))

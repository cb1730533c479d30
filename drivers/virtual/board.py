"""How does the virtual machine's slave board behave? It runs the board's own program, with the
plant in place of the pins.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable

from topdress.control.readings import DoseOrder, DriveCommand
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.board.framing import Receiver
from topdress.drivers.board.motion import StepperDoser
from topdress.drivers.board.slave import DOSE_DONE, BoardSettings, Pins, SlaveProgram
from topdress.drivers.devices.board_frames import (
    MAX_SECTION_VALVES,
    OPENING_SET_POINT_RANGE_MM,
    SHAFT_SET_POINT_RANGE_RPM,
    decode_valves,
    encode_valves,
)
from topdress.drivers.devices.lines import Counts

# Counts of the real encoder per turn of the shaft; the board uses the number in its settings
# instead.
TRUE_COUNTS_PER_TURN = 2000.0


class _PlantPins(Pins):
    """Connects the plant to the board's program. `sensed` holds the plant's last readings, `inbox`
    bytes from the host, `outbox` bytes to the host, `turns` those of the shaft."""

    sensed: SensorReadings
    turns = 0.0

    def __init__(self, chance: Callable[[], int | None], driver_fault: Callable[[], bool]) -> None:
        self.inbox = self.outbox = b""
        self._pulses, self._pulse_s = 0, 0.0
        for name, tells in (
            ("chance", chance),
            ("driver_fault", driver_fault),
            *(
                (name, lambda name=name: getattr(self.sensed, name))
                # A board's sensors have the names of the plant's.
                for name in SensorReadings._fields
                if hasattr(Pins, name) and name not in vars(_PlantPins)
            ),
        ):
            setattr(self, name, tells)

    def read(self) -> bytes:
        """Returns the bytes that the host has sent."""
        data, self.inbox = self.inbox, b""
        return data

    def write(self, data: bytes) -> None:
        """Sends bytes to the host."""
        self.outbox += data

    def wheel(self) -> tuple[int, int]:
        """Returns the wheel's pulses and the time of the last one; a pulse without a known time
        counts at the end of its tick."""
        if self.sensed.wheel_pulses != self._pulses:
            self._pulses = self.sensed.wheel_pulses
            self._pulse_s = self.sensed.wheel_pulse_s or self.sensed.time_s
        return self._pulses, round(self._pulse_s * 1e6)

    def shaft_counts(self) -> int:
        """Returns the counts of the shaft's encoder."""
        return round(self.turns * TRUE_COUNTS_PER_TURN)

    def valves_open(self) -> int | None:
        """Returns the positions of the section valves as a bit mask; None without switches."""
        return None if self.sensed.valves_open is None else encode_valves(self.sensed.valves_open)


class _CountingReceiver(Receiver):
    """Receives frames and counts the rejected frames by kind."""

    def __init__(self, counts: Counts) -> None:
        super().__init__()
        self._counts = counts

    def reject(self, kind: str) -> None:
        """Counts one rejected frame."""
        self._counts.reject(kind)


class _PlantDoser(StepperDoser):
    """Delivers a dose through the plant: one `DoseOrder` takes the place of motor steps."""

    turned_deg = 0.0
    # The order that the plant has not taken yet.
    order: DoseOrder | None = None
    takes_us = 0

    def start_dose(self, angle_deg: float, shaft_rpm: float) -> None:
        """Stores the dose for the plant."""
        self.running, self.order = True, DoseOrder(angle_deg, shaft_rpm)
        self.turned_deg, self.takes_us = angle_deg, round(angle_deg / (6.0 * shaft_rpm) * 1e6)


class VirtualBoard(SlaveProgram):
    """Simulates one board.

    At rest the shaft stops and the gate keeps its set-point; at power-on the set-point is
    `opening_mm`. `chance` is the source of the board's random words, as in the board's own program;
    None simulates an older board without words. Set-points are taken unchanged, because the host
    applies the limits.
    """

    def __init__(
        self,
        opening_mm: float = 0.0,
        chance: Callable[[], int | None] = lambda: secrets.randbits(32),
    ) -> None:
        self.counts = Counts()
        # Tests and fault injection set this flag.
        self.driver_fault = False
        self._plant = _PlantPins(chance, lambda: self.driver_fault)
        settings = BoardSettings()
        settings.max_shaft_rpm, settings.max_opening_mm = (
            SHAFT_SET_POINT_RANGE_RPM[1],
            OPENING_SET_POINT_RANGE_MM[1],
        )
        settings.valves = MAX_SECTION_VALVES
        super().__init__(self._plant, settings)
        self.receiver = _CountingReceiver(self.counts)
        self._doser: _PlantDoser = _PlantDoser(1.0, 1.0)
        self._gate.set_reference(opening_mm)
        self._opening_mm = opening_mm
        self._valved = False

    @property
    def word(self) -> int | None:
        """Returns the word under which the board takes orders now."""
        return self._newest.word

    def feed_commands(self, data: bytes, now_s: float) -> None:
        """Takes commands received at `now_s`. Wrong commands are counted by kind and change
        nothing, but an old command stops the board."""
        self._plant.inbox += data
        self.take_orders(_convert_to_us(now_s))

    def find_set_points(self, now_s: float) -> tuple[DriveCommand, bool]:
        """Returns the set-points that the drives follow at `now_s`, and whether they are
        enabled."""
        self.take_orders(_convert_to_us(now_s))
        if self.enabled:
            self._opening_mm = self._commanded_mm
        valves = decode_valves(self._wanted_valves if self.enabled else 0) if self._valved else ()
        return DriveCommand(
            self._wanted_rpm if self.enabled else 0.0, self._opening_mm, valves=valves
        ), self.enabled

    def take_dose(self, now_s: float) -> DoseOrder | None:
        """Returns the dose that the plant begins in this step; called once a step. A stop ends the
        present dose."""
        now_us, dose = _convert_to_us(now_s), self._doser
        self.take_orders(now_us)
        end_us = self._dose_begin_us + dose.takes_us
        if dose.running and not self.enabled:
            dose.turned_deg *= min(1.0, (now_us - self._dose_begin_us) / dose.takes_us)
            dose.order = None
            self._stop_shaft(now_us)
        elif dose.running and now_us >= end_us:
            dose.running = False
            self._report_dose(self._dose, DOSE_DONE, dose.turned_deg, self._dose_begin_us, end_us)
        order, dose.order = dose.order, None
        return order

    def turn_encoder(self, shaft_rpm: float, for_s: float) -> None:
        """Turns the encoder by `for_s` seconds at `shaft_rpm`, whichever drive turns the shaft."""
        self._plant.turns += shaft_rpm / 60.0 * for_s

    def make_status(self, sensed: SensorReadings, now_s: float) -> bytes:
        """Returns the status line of this tick, on the plant's clock, and other messages."""
        self._plant.sensed, self.shaft_rpm = sensed, sensed.shaft_rpm
        self.take_orders(_convert_to_us(now_s))
        self.send_status(_convert_to_us(now_s), _convert_to_us(sensed.time_s))
        outbox, self._plant.outbox = self._plant.outbox, b""
        return outbox

    def _obey_order(self, fields: list[bytes], now_us: int) -> None:
        super()._obey_order(fields, now_us)
        self.counts.accept()

    def _set_target(self, fields: list[bytes], valved: bool, now_us: int) -> None:
        super()._set_target(fields, valved, now_us)
        self._valved = valved


def _convert_to_us(at_s: float) -> int:
    return round(at_s * 1e6)

"""How does the slave board move the drives? Its program takes commands, moves the drives, stops
safely without the host, and sends the status.

`SlaveProgram.run_round` is called about every millisecond by a main program that has the pins
(`rp2_slave.py`). A pin layer has:

    read() -> bytes                 bytes from the host; returns at once, mostly empty
    write(data)                     sends to the host; must not wait
    enable(on)                      sets the enable lines of the motor drivers
    duty(value)                     sets the duty of the shaft's DC motor, 0 to 1
    shaft_counts() -> int           counts of the shaft's encoder; not read where
                                    `counts_per_turn` is 0
    gate_steps(steps)               makes steps of the gate now, positive opens
    dose_steps(steps)               makes steps of a shaft with a stepper (metering, point dose)
    opening_mm() -> float or None   displacement sensor; None without a sensor
    at_home() -> bool               the gate's switch; read only without a displacement sensor
    driver_fault() -> bool
    wheel() -> (pulses, us)         count, and time of the newest pulse on the board's clock
    hopper_kg(), supply_v(), pitch_deg(), roll_deg() -> float or None
    shaft_effort(), gate_effort() -> float or None      effort of each drive: % of full duty, A
                                                        or N m
    work_switch() -> bool or None
    valves(mask)                    sets the section valves: bit 0 is the leftmost, 1 opens;
                                    called when the mask changes
    valves_open() -> int or None    the mask by the valves' own switches; None without switches
    chance() -> int or None         an unpredictable number below 2^32; None: only orders
                                    without a word are accepted
"""

from .framing import (
    SEQUENCE_MODULUS,
    WORD_MODULUS,
    NewestOrder,
    Receiver,
    format_decimal,
    parse_number,
    parse_whole,
    seal_frame,
)
from .motion import GateMotion, ShaftControl, SpeedMeter, SteppedShaft, StepperDoser

# Silence of the host after which the drives stop, microseconds.
HOST_TIMEOUT_US = 1000000
# Period of the shaft control, microseconds.
CONTROL_PERIOD_US = 10000
# Interval of the status lines, microseconds.
STATUS_INTERVAL_US = 25000
# The report of a dose is repeated for this time, microseconds, because a line may lose it.
REPORT_REPEAT_US = 300000
# An old order is reported in the status for this time, microseconds.
OLD_ORDER_REPORT_US = 1000000
# Steps beyond this length of a round are dropped, s, because in one burst they would stall the
# motor.
MAX_STEPPED_ROUND_S = 0.005

ENABLED, HEARTBEAT_LOST, DRIVER_FAULT, STEPS_LOST, HOMING, WORD_UNUSED, OLD_ORDER = (
    1,
    2,
    4,
    8,
    16,
    32,
    64,
)
FRAME_FIELDS = {b"T1": 5, b"T2": 6, b"T3": 7, b"D1": 5, b"D3": 6, b"A1": 1, b"A2": 1}
DOSE_RUNNING, DOSE_DONE, DOSE_REFUSED, DOSE_ABORTED = 1, 2, 3, 4


class BoardSettings:
    """Holds the wiring and tuning of this board. Change the values in `board_settings.py` on the
    board, which `take_settings` reads."""

    # Line to the host: "uart" (GP0, GP1) or "usb" (the board's own plug).
    link = "uart"
    # Metering drive: "dc", a motor controlled by its duty, or "stepper", a motor moved by steps.
    shaft_drive = "dc"
    max_shaft_rpm = 100.0
    max_opening_mm = 60.0
    # Counts of the shaft's encoder per turn; 0 means no encoder, which only a stepper permits.
    counts_per_turn = 2400.0
    # Slope of the duty at nominal supply.
    duty_per_rpm = 0.008
    duty_to_start = 0.04
    # Time constant of the motor together with the measurement of its speed, s.
    time_constant_s = 0.13
    kp = 0.004
    ki = 0.03
    acceleration_rpm_s = 400.0
    # The shaft counts as jammed where it is slower than expected by more than this share and ...
    held_share = 0.25
    # ... by this speed, r/min; the integrator then stops.
    held_rpm = 5.0
    # The gate has 400 half steps per turn and a spindle with a lead of 4 mm.
    steps_per_mm = 100.0
    gate_mm_s = 20.0
    gate_acceleration_mm_s2 = 200.0
    home_mm_s = 5.0
    lost_mm = 1.0
    lost_after_s = 0.5
    # Steps per turn of the shaft's stepper, for doses and metering, in microstep mode 2.
    dose_steps_per_turn = 400.0
    dose_acceleration_rpm_s = 2000.0
    # Acceleration of metering by the stepper: 0 to 100 r/min in a third of a second.
    stepper_steps_s2 = 2000.0
    # Fastest steps of the stepper: 4 steps in a round of a millisecond.
    stepper_steps_s = 4000.0
    # Number of section valves; a board with 0 does not obey T2.
    valves = 0
    # True refuses all orders without a word (T1, T2, D1), even before the first order with a word.
    words_only = False

    def take_settings(self, own: object) -> None:
        """Takes the values of a module or class `own`. Raises ValueError with one line for an
        impossible value; the board does not start then, and its drives stay off."""
        for name in dir(own):
            if name.startswith("_"):
                continue
            value, usual = getattr(own, name), getattr(self, name, None)
            if usual is None or name == "take":
                raise ValueError(f"{name}: no setting of this board")
            kinds = (float, int) if isinstance(usual, float) else (type(usual),)
            if type(value) not in kinds:
                raise ValueError(f"{name} {value!r}: allowed is a value like {usual!r}")
            setattr(self, name, value)
        for name, allowed in ALLOWED_SETTINGS.items():
            value, word = getattr(self, name), isinstance(allowed[0], str)
            if not (value in allowed if word else allowed[0] <= value <= allowed[1]):
                between = "or" if word else "to"
                raise ValueError(
                    f"{name} {value!r}: allowed is {allowed[0]} {between} {allowed[1]}"
                )
        if self.shaft_drive == "dc" and not self.counts_per_turn:
            raise ValueError("counts_per_turn 0: allowed only with shaft_drive 'stepper'")
        asked = self.max_shaft_rpm / 60.0 * self.dose_steps_per_turn
        if self.shaft_drive == "stepper" and asked > self.stepper_steps_s:
            raise ValueError(
                f"max_shaft_rpm {self.max_shaft_rpm!r}: asks {asked:.0f} steps a second of "
                "the stepper: "
                f"allowed is stepper_steps_s, {self.stepper_steps_s:.0f}"
            )


ALLOWED_SETTINGS = {
    "link": ("uart", "usb"),
    "shaft_drive": ("dc", "stepper"),
    "counts_per_turn": (0.0, 100000.0),
    "dose_steps_per_turn": (20.0, 51200.0),
    "max_shaft_rpm": (1.0, 300.0),
    "max_opening_mm": (1.0, 100.0),
    "stepper_steps_s2": (100.0, 20000.0),
    "stepper_steps_s": (100.0, 8000.0),
    "valves": (0, 16),
}


class Pins:
    """Defines the hardware functions that the program needs; in this base class all hardware is
    absent. Pin layers and tests inherit from it."""

    def _absent(self) -> "float | None":
        return None

    def _unknown(self) -> "int | None":
        return None

    def _ignored(self, value: int) -> None:
        pass

    gate_steps = dose_steps = valves = _ignored
    opening_mm = hopper_kg = supply_v = pitch_deg = roll_deg = shaft_effort = gate_effort = _absent
    work_switch = valves_open = chance = _unknown

    def enable(self, on: bool) -> None:
        """Enables or disables the drivers."""

    def duty(self, value: float) -> None:
        """Sets the duty of the shaft motor, 0 to 1."""

    def read(self) -> bytes:
        """Returns the bytes that the host has sent."""
        return b""

    def write(self, data: bytes) -> None:
        """Sends bytes to the host."""

    def shaft_counts(self) -> int:
        """Returns the encoder's counts since power-on."""
        return 0

    def at_home(self) -> bool:
        """Returns whether the gate presses the home switch."""
        return False

    def driver_fault(self) -> bool:
        """Returns whether the motor driver reports a fault."""
        return False

    def wheel(self) -> "tuple[int, int]":
        """Returns the wheel's pulses and the time of the newest one, microseconds."""
        return 0, 0


class SlaveProgram:
    """Holds the state of the program. `run_round` runs one round; it neither waits nor reads a
    clock."""

    def __init__(self, pins: Pins, settings: BoardSettings) -> None:
        self.receiver = Receiver()
        self.enabled = False
        self.shaft_rpm = 0.0
        self._pins, self._settings = pins, settings
        self._wanted_rpm = 0.0
        # None means that the gate keeps its opening.
        self._wanted_mm: float | None = None
        self._commanded_mm = 0.0
        self._enable = False
        self._armed = False
        self._heartbeat_lost = False
        # None means that the host has not sent anything yet, or is silent.
        self._heard_us: int | None = None
        self._newest = NewestOrder(pins.chance, settings.words_only)
        self._old_order_until_us = 0
        self._status_seq = 0
        self._encoder = settings.counts_per_turn > 0.0
        self._meter = SpeedMeter(
            settings.counts_per_turn if self._encoder else settings.dose_steps_per_turn
        )
        self._shaft = ShaftControl(
            settings.duty_per_rpm,
            settings.duty_to_start,
            settings.time_constant_s,
            kp=settings.kp,
            ki=settings.ki,
            acceleration_rpm_s=settings.acceleration_rpm_s,
            held_share=settings.held_share,
            held_rpm=settings.held_rpm,
        )
        self._gate = GateMotion(
            settings.steps_per_mm,
            settings.gate_mm_s,
            settings.gate_acceleration_mm_s2,
            settings.home_mm_s,
            settings.lost_mm,
            settings.lost_after_s,
        )
        self._doser = StepperDoser(settings.dose_steps_per_turn, settings.dose_acceleration_rpm_s)
        # None means that a DC motor turns the metering shaft.
        self._stepped: SteppedShaft | None = None
        if settings.shaft_drive == "stepper":
            self._stepped = SteppedShaft(
                settings.dose_steps_per_turn,
                settings.stepper_steps_s2,
                settings.stepper_steps_s,
                held_share=settings.held_share,
                held_rpm=settings.held_rpm,
                lost_after_s=settings.lost_after_s,
            )
        # Steps of the shaft's stepper since power-on.
        self._steps = 0
        self._dose = -1
        self._dose_begin_us = 0
        self._report = ""
        self._report_until_us = 0
        self._last_us: int | None = None
        self._next_control_us = 0
        self._next_status_us = 0
        self._control_us: int | None = None
        # All valves are closed at power-on and unless enabled.
        self._wanted_valves = self._valves = 0
        pins.enable(False)
        pins.duty(0.0)
        pins.valves(0)

    def run_round(self, now_us: int) -> None:
        """Runs one round at `now_us` of a clock that never overflows."""
        pins = self._pins
        dt_s = 0.0 if self._last_us is None else min(now_us - self._last_us, 20000) * 1e-6
        self._last_us = now_us
        before = self.enabled
        self.take_orders(now_us)
        enabled = self.enabled
        if enabled != before:
            pins.enable(enabled)
        if not enabled:
            self._stop_shaft(now_us)
        valves = self._wanted_valves if enabled else 0
        if valves != self._valves:
            self._valves = valves
            pins.valves(valves)
        self._move_gate(enabled, dt_s)
        self._turn_stepper(now_us, dt_s)
        if now_us >= self._next_control_us:
            self._control_shaft(enabled, now_us)
        if now_us >= self._next_status_us:
            self._next_status_us = now_us + STATUS_INTERVAL_US
            self.send_status(now_us, now_us)

    def take_orders(self, now_us: int) -> None:
        """Takes the host's orders: the newest is in force from here on, and `enabled` tells whether
        the drives are enabled."""
        if self._heard_us is not None and now_us - self._heard_us >= HOST_TIMEOUT_US:
            self._heartbeat_lost, self._armed, self._heard_us = True, False, None
            self._newest.renew_word()
        for fields in self.receiver.feed_bytes(self._pins.read()):
            try:
                self._obey_order(fields, now_us)
            except ValueError as kind:
                self._reject_order(str(kind.args[0]), now_us)
        self.enabled = self._armed and self._enable and not self._pins.driver_fault()

    def send_status(self, now_us: int, clock_us: int) -> None:
        """Sends the status, with `clock_us` as the board's clock, and the report of a dose."""
        self._pins.write(self._make_status(now_us, clock_us))
        if now_us < self._report_until_us:
            self._pins.write(seal_frame(f"E1,{self._take_sequence()},{self._report}"))

    def _reject_order(self, kind: str, now_us: int) -> None:
        """Counts a fault. An old order stops the board until enable 0 arrives.

        Before the first order with the word the host does not know the word; its old orders are
        then no fault of the line.
        """
        self.receiver.reject(kind)
        if kind == "old_order":
            self._armed = False
            if self._newest.used or self._newest.word is None:
                self._old_order_until_us = now_us + OLD_ORDER_REPORT_US

    def _obey_order(self, fields: "list[bytes]", now_us: int) -> None:
        """Obeys an order. Raises ValueError with the kind of fault; nothing has changed then."""
        name = fields[0]
        if name not in FRAME_FIELDS or (
            name in (b"A1", b"T3", b"D3") and self._newest.word is None
        ):
            raise ValueError("unknown_frame")
        valved = name == b"T2" or (name == b"T3" and fields[5:6] not in ([], [b""]))
        if valved and self._settings.valves == 0:
            raise ValueError("unknown_frame")
        if len(fields) != FRAME_FIELDS[name]:
            raise ValueError("wrong_length")
        if name == b"A2":
            self._pins.write(self._make_turned())
        elif name == b"A1":
            self._pins.write(seal_frame(f"W1,{self._take_sequence()},{self._newest.word}"))
        elif name in (b"D1", b"D3"):
            self._start_dose(fields, now_us)
        else:
            self._set_target(fields, valved, now_us)

    def _set_target(self, fields: "list[bytes]", valved: bool, now_us: int) -> None:
        enable = parse_whole(fields[4], 1)
        valves = parse_whole(fields[5], (1 << self._settings.valves) - 1) if valved else 0
        rpm, opening_mm = parse_number(fields[2], 0.0, 300.0), parse_number(fields[3], 0.0, 100.0)
        self._accept_order(fields)
        if not enable:
            self._armed, self._heartbeat_lost = True, False
            self._gate.clear_lost()
        self._heard_us, self._enable = now_us, bool(enable)
        self._wanted_valves = valves
        self._wanted_rpm = min(rpm, self._settings.max_shaft_rpm)
        self._commanded_mm = min(opening_mm, self._settings.max_opening_mm)

    def _accept_order(self, fields: "list[bytes]") -> None:
        """Accepts only newer orders; the word is the last field of an order."""
        if fields[0].endswith(b"3"):
            self._newest.accept_order(
                parse_whole(fields[1], WORD_MODULUS - 1), parse_whole(fields[-1], WORD_MODULUS - 1)
            )
        else:
            self._newest.accept_order(parse_whole(fields[1], SEQUENCE_MODULUS - 1), None)

    def _start_dose(self, fields: "list[bytes]", now_us: int) -> None:
        dose = parse_whole(fields[2], SEQUENCE_MODULUS - 1)
        angle_deg, rpm = parse_number(fields[3], 0.0, 3600.0), parse_number(fields[4], 1.0, 300.0)
        self._accept_order(fields)
        if not self.enabled or self._doser.running or self._wanted_rpm > 0.0:
            self._report_dose(dose, DOSE_REFUSED, 0.0, now_us, now_us)
            return
        self._dose, self._dose_begin_us = dose, now_us
        self._doser.start_dose(angle_deg, min(rpm, self._settings.max_shaft_rpm))
        self._report_dose(dose, DOSE_RUNNING, 0.0, now_us, now_us)

    def _stop_shaft(self, now_us: int) -> None:
        self._pins.duty(self._shaft.stop_shaft())
        if self._stepped is not None:
            self._stepped.stop_shaft()
        if self._doser.running:
            self._doser.abort_dose()
            self._report_dose(
                self._dose, DOSE_ABORTED, self._doser.turned_deg, self._dose_begin_us, now_us
            )

    def _turn_stepper(self, now_us: int, dt_s: float) -> None:
        """Turns the stepper for a dose, or for metering; `_stop_shaft` has ended both where the
        drives are not enabled."""
        if self._doser.running:
            steps = self._doser.step_dose(dt_s)
            if not self._doser.running:
                self._report_dose(
                    self._dose, DOSE_DONE, self._doser.turned_deg, self._dose_begin_us, now_us
                )
        elif self._stepped is not None and self.enabled:
            steps = self._stepped.step_shaft(
                self._find_metered_rpm(), min(dt_s, MAX_STEPPED_ROUND_S)
            )
        else:
            return
        if steps:
            self._steps += steps
            self._pins.dose_steps(steps)

    def _find_metered_rpm(self) -> float:
        """Returns the set-point of the shaft, r/min; 0 while the gate searches for its switch."""
        return self._wanted_rpm if self._gate.homed else 0.0

    def _move_gate(self, enabled: bool, dt_s: float) -> None:
        pins, gate = self._pins, self._gate
        sensor_mm = pins.opening_mm()
        if not gate.homed and sensor_mm is not None:
            gate.set_reference(sensor_mm)
        if enabled:
            self._wanted_mm = self._commanded_mm
        if self._wanted_mm is None:
            return
        if gate.homed:
            steps = gate.step_to_opening(self._wanted_mm, sensor_mm, dt_s)
        else:
            steps = gate.step_home(pins.at_home(), dt_s) if enabled else 0
        if steps:
            pins.gate_steps(steps)

    def _control_shaft(self, enabled: bool, now_us: int) -> None:
        self._next_control_us = now_us + CONTROL_PERIOD_US
        dt_s = 0.0 if self._control_us is None else (now_us - self._control_us) * 1e-6
        self._control_us = now_us
        self.shaft_rpm = self._meter.measure_rpm(
            now_us, self._pins.shaft_counts() if self._encoder else self._steps
        )
        if enabled and self._stepped is None:
            self._pins.duty(self._shaft.update_duty(self._find_metered_rpm(), self.shaft_rpm, dt_s))
        elif self._stepped is not None and self._encoder:
            self._stepped.compare_encoder(self.shaft_rpm, dt_s)

    def _report_dose(
        self, dose: int, state: int, turned_deg: float, begin_us: int, end_us: int
    ) -> None:
        self._report = (
            f"{dose},{state},{turned_deg:.3f},{begin_us % WORD_MODULUS},{end_us % WORD_MODULUS}"
        )
        self._report_until_us = end_us + REPORT_REPEAT_US
        self._pins.write(seal_frame(f"E1,{self._take_sequence()},{self._report}"))

    def _make_status(self, now_us: int, clock_us: int) -> bytes:
        pins = self._pins
        pulses, pulse_us = pins.wheel()
        sensor_mm = pins.opening_mm()
        switch = pins.work_switch()
        valves = pins.valves_open()
        flags = ENABLED * self.enabled | HEARTBEAT_LOST * self._heartbeat_lost
        flags |= DRIVER_FAULT * bool(pins.driver_fault()) | STEPS_LOST * self._gate.lost
        flags |= HOMING * (self.enabled and not self._gate.homed) | OLD_ORDER * (
            now_us < self._old_order_until_us
        )
        flags |= WORD_UNUSED * (self._newest.word is not None and not self._newest.used)
        name, more = ("S1", "") if valves is None else ("S2", f",{valves}")
        shaft_effort, gate_effort = pins.shaft_effort(), pins.gate_effort()
        if shaft_effort is not None or gate_effort is not None:
            name, more = (
                "S3",
                (more or ",")
                + ","
                + format_decimal(shaft_effort, 0.0, 1000.0)
                + ","
                + format_decimal(gate_effort, 0.0, 1000.0),
            )
        return seal_frame(
            ",".join(
                (
                    name,
                    str(self._take_sequence()),
                    str(max(self._newest.last, 0) % SEQUENCE_MODULUS),
                    str(clock_us % WORD_MODULUS),
                    str(pulses % WORD_MODULUS),
                    str(pulse_us % WORD_MODULUS),
                    format_decimal(self.shaft_rpm, -10.0, 400.0) or "0.000",
                    format_decimal(
                        self._gate.reckoned_mm if sensor_mm is None else sensor_mm, -10.0, 110.0
                    )
                    or "0.000",
                    format_decimal(pins.hopper_kg(), -100.0, 5000.0),
                    format_decimal(pins.supply_v(), 0.0, 60.0),
                    format_decimal(pins.pitch_deg(), -60.0, 60.0),
                    format_decimal(pins.roll_deg(), -60.0, 60.0),
                    "" if switch is None else str(int(switch)),
                    f"{int(flags)}{more}",
                )
            )
        )

    def _make_turned(self) -> bytes:
        """Returns the frame with the turns of the shaft since power-on and the counts per turn, for
        the encoder and for the stepper."""
        settings = self._settings
        counts = (
            f"{self._pins.shaft_counts() % WORD_MODULUS},{settings.counts_per_turn:.3f}"
            if self._encoder
            else ","
        )
        steps = (
            ","
            if self._stepped is None
            else f"{self._steps % WORD_MODULUS},{settings.dose_steps_per_turn:.3f}"
        )
        return seal_frame(f"C1,{self._take_sequence()},{counts},{steps}")

    def _take_sequence(self) -> int:
        seq, self._status_seq = self._status_seq, (self._status_seq + 1) % SEQUENCE_MODULUS
        return seq

"""How do the drives move? The shaft speed is controlled by PI with feed-forward, gate and doses by
counted steps. The module is pure: time is an argument.
"""


class SpeedMeter:
    """Measures the speed from an encoder's count, as the mean over the last `window_us`
    microseconds."""

    def __init__(self, counts_per_turn: float, window_us: int = 50000) -> None:
        self._per_turn = counts_per_turn
        self._window_us = window_us
        # Pairs of time (microseconds) and count, oldest first.
        self._seen: list[tuple[int, int]] = []

    def measure_rpm(self, now_us: int, counts: int) -> float:
        """Returns the speed, r/min, positive in the direction of rising counts."""
        seen = self._seen
        seen.append((now_us, counts))
        while len(seen) > 2 and now_us - seen[1][0] >= self._window_us:
            seen.pop(0)
        over_us = now_us - seen[0][0]
        if over_us <= 0:
            return 0.0
        return (counts - seen[0][1]) * 60e6 / (over_us * self._per_turn)


class ShaftControl:
    """Controls the duty of a DC motor, 0 to 1, by feed-forward from the motor's characteristic
    curve and a PI term for the remaining error.

    The set-point changes no faster than `acceleration_rpm_s`. The error is the difference to the
    expected reading of a motor with `time_constant_s`, so that a ramp that the motor follows
    correctly does not change the integrator. Anti-windup stops the integrator in two cases: the
    shaft is slower than expected by more than `held_share` of the speed and `held_rpm` (a jammed
    shaft), or the duty is at its limit and the error would drive it further. The integrator is
    limited to `held_share` of the feed-forward and reset at every stop.
    """

    def __init__(
        self,
        duty_per_rpm: float,
        duty_to_start: float,
        time_constant_s: float,
        *,
        kp: float,
        ki: float,
        acceleration_rpm_s: float,
        held_share: float,
        held_rpm: float,
    ) -> None:
        self._held_share, self._held_rpm = held_share, held_rpm
        self._duty_per_rpm, self._duty_to_start = duty_per_rpm, duty_to_start
        self._kp, self._ki = kp, ki
        self._acceleration = acceleration_rpm_s
        self._time_constant_s = time_constant_s
        self.ramped_rpm = 0.0
        self.expected_rpm = 0.0
        self.integral = 0.0

    def stop_shaft(self) -> float:
        """Stops the control and returns the duty of a standing shaft, 0."""
        self.ramped_rpm = self.expected_rpm = self.integral = 0.0
        return 0.0

    def update_duty(self, wanted_rpm: float, measured_rpm: float, dt_s: float) -> float:
        """Returns the duty for the next `dt_s` seconds; a set-point of 0 stops at once."""
        if wanted_rpm <= 0.0:
            return self.stop_shaft()
        most = self._acceleration * dt_s
        self.ramped_rpm += min(max(wanted_rpm - self.ramped_rpm, -most), most)
        self.expected_rpm += (self.ramped_rpm - self.expected_rpm) * min(
            1.0, dt_s / self._time_constant_s
        )
        error = self.expected_rpm - measured_rpm
        held = error > self._held_share * self.expected_rpm + self._held_rpm
        free = (
            self._duty_to_start
            + self._duty_per_rpm * self.ramped_rpm
            + self._kp * error
            + self.integral
        )
        duty = min(max(free, 0.0), 1.0)
        if not held and (
            free == duty or (free > 1.0 and error < 0.0) or (free < 0.0 and error > 0.0)
        ):
            most = self._held_share * self._duty_per_rpm * self.expected_rpm
            self.integral = min(max(self.integral + self._ki * error * dt_s, -most), most)
        return duty


class Stepper:
    """Makes steps to a position or at a speed, along a ramp of constant acceleration. `place`
    counts the steps."""

    def __init__(self, fastest_steps_s: float, acceleration_steps_s2: float) -> None:
        self.place = 0
        self.speed_steps_s = 0.0
        self._fastest, self._acceleration = fastest_steps_s, acceleration_steps_s2
        self._phase = 0.0

    def halt_steps(self) -> None:
        """Stops at once, without a ramp."""
        self.speed_steps_s = self._phase = 0.0

    def step_at_speed(self, steps_s: float, dt_s: float) -> int:
        """Returns the steps to make now, signed, towards this speed; `place` is updated."""
        most = self._acceleration * dt_s
        self.speed_steps_s += min(max(steps_s - self.speed_steps_s, -most), most)
        self._phase += self.speed_steps_s * dt_s
        steps = int(self._phase)
        self._phase -= steps
        self.place += steps
        return steps

    def step_to_place(self, wanted: int, dt_s: float) -> int:
        """Returns the steps to make now, signed, towards this position."""
        ahead = wanted - self.place
        if ahead == 0 and abs(self.speed_steps_s) <= self._acceleration * dt_s:
            self.halt_steps()
            return 0
        brake = (2.0 * self._acceleration * abs(ahead)) ** 0.5
        steps = self.step_at_speed(
            min(self._fastest, brake) * (1.0 if ahead > 0 else -1.0 if ahead < 0 else 0.0), dt_s
        )
        if ahead and abs(steps) > abs(ahead) and (steps > 0) == (ahead > 0):
            self.halt_steps()
            self.place, steps = wanted, ahead
        return steps


class GateMotion:
    """Moves the gate by counted steps. The displacement sensor or the switch gives the reference,
    and the sensor reveals lost steps.

    `opening_mm` of the sensor is None where no sensor is fitted. `lost` means that the sensor
    revealed lost steps, which were corrected; `clear_lost` clears the flag.
    """

    def __init__(
        self,
        steps_per_mm: float,
        fastest_mm_s: float,
        acceleration_mm_s2: float,
        home_mm_s: float,
        lost_mm: float,
        lost_after_s: float,
    ) -> None:
        self._per_mm = steps_per_mm
        self._stepper = Stepper(fastest_mm_s * steps_per_mm, acceleration_mm_s2 * steps_per_mm)
        self._home_steps_s = home_mm_s * steps_per_mm
        self._lost_mm, self._lost_after_s = lost_mm, lost_after_s
        self._apart_s = 0.0
        self._home_phase = 0.0
        self.homed = False
        self.lost = False

    @property
    def reckoned_mm(self) -> float:
        """Opening by counted steps, mm."""
        return self._stepper.place / self._per_mm

    def set_reference(self, opening_mm: float) -> None:
        """Sets the reference: the present opening of the gate, mm."""
        self._stepper.place = round(opening_mm * self._per_mm)
        self._stepper.halt_steps()
        self.homed = True

    def clear_lost(self) -> None:
        """Clears the flag that steps were lost."""
        self.lost = False

    def step_home(self, at_switch: bool, dt_s: float) -> int:
        """Returns the closing steps of the search for the switch; 0 at the switch."""
        if at_switch:
            self.set_reference(0.0)
            return 0
        self._home_phase += self._home_steps_s * dt_s
        steps = int(self._home_phase)
        self._home_phase -= steps
        return -steps

    def step_to_opening(self, wanted_mm: float, sensor_mm: "float | None", dt_s: float) -> int:
        """Returns the steps towards `wanted_mm`; positive steps open the gate."""
        if sensor_mm is not None:
            apart = abs(sensor_mm - self.reckoned_mm) > self._lost_mm
            self._apart_s = self._apart_s + dt_s if apart else 0.0
            if self._apart_s > self._lost_after_s:
                self._apart_s = 0.0
                self.lost = True
                self.set_reference(sensor_mm)
        return self._stepper.step_to_place(round(wanted_mm * self._per_mm), dt_s)


class StepperDoser:
    """Turns a stepper's shaft by an angle, dose after dose; the remainder of rounding to steps is
    added to the next dose."""

    def __init__(self, steps_per_turn: float, acceleration_rpm_s: float) -> None:
        self._per_turn = steps_per_turn
        self._acceleration = acceleration_rpm_s / 60.0 * steps_per_turn
        self._over = 0.0
        self._stepper = Stepper(0.0, self._acceleration)
        # Steps of the present dose.
        self.steps = 0
        self.running = False

    @property
    def turned_deg(self) -> float:
        """Angle turned for this dose, degrees."""
        return self._stepper.place * 360.0 / self._per_turn

    def start_dose(self, angle_deg: float, shaft_rpm: float) -> None:
        """Starts a dose of an angle in degrees at a shaft speed in r/min."""
        wanted = angle_deg * self._per_turn / 360.0 + self._over
        self.steps = round(wanted)
        self._over = wanted - self.steps
        self._stepper = Stepper(shaft_rpm / 60.0 * self._per_turn, self._acceleration)
        self.running = True

    def abort_dose(self) -> None:
        """Ends the dose at the present angle of the shaft."""
        self.running = False

    def step_dose(self, dt_s: float) -> int:
        """Returns the steps to make now."""
        if not self.running:
            return 0
        steps = self._stepper.step_to_place(self.steps, dt_s)
        if self._stepper.place >= self.steps:
            self.running = False
        return steps


class SteppedShaft:
    """Turns the metering shaft by a stepper.

    The motor has stalled where an encoder shows the shaft slower than its steps by more than
    `held_share` of them and `held_rpm` for `lost_after_s`. Steps at full speed cannot restart a
    stalled motor, so the ramp begins anew.
    """

    def __init__(
        self,
        steps_per_turn: float,
        steps_s2: float,
        most_steps_s: float,
        *,
        held_share: float,
        held_rpm: float,
        lost_after_s: float,
    ) -> None:
        self._per_turn, self._most = steps_per_turn, most_steps_s
        self._held_share, self._held_rpm, self._lost_after_s = held_share, held_rpm, lost_after_s
        self._stepper = Stepper(most_steps_s, steps_s2)
        self._slow_s = 0.0

    def stop_shaft(self) -> None:
        """Stops without a further step."""
        self._stepper.halt_steps()
        self._slow_s = 0.0

    def step_shaft(self, wanted_rpm: float, dt_s: float) -> int:
        """Returns the steps to make now; a set-point of 0 stops at once."""
        if wanted_rpm <= 0.0:
            self.stop_shaft()
            return 0
        return self._stepper.step_at_speed(
            min(wanted_rpm / 60.0 * self._per_turn, self._most), dt_s
        )

    def compare_encoder(self, measured_rpm: float, dt_s: float) -> None:
        """Compares the steps with the encoder; called every `dt_s` seconds."""
        stepped_rpm = self._stepper.speed_steps_s * 60.0 / self._per_turn
        slow = stepped_rpm - measured_rpm > self._held_share * stepped_rpm + self._held_rpm
        self._slow_s = self._slow_s + dt_s if slow else 0.0
        if self._slow_s > self._lost_after_s:
            self.stop_shaft()

"""How does the metering shaft follow its command? The model maps r/min to r/min: dead time, dead
band, supply and load, first or second order, acceleration limit.

Commands and speeds have a sign. Below 0, or below the command at which the shaft stands, the shaft
turns backwards, with its own gain and dead zone.
"""

from __future__ import annotations

from math import atan2, cos, exp, log, pi, sin, sqrt
from typing import Annotated, NamedTuple

from pydantic import Field

from .effect import LONGEST_ANSWER, SHAFT_RANGE, Effect
from .model_elements import DelayLine, make_line, put_in_line, read_held_line, round_to_step

# Minimum time constant of a machine file, s.
MIN_TIME_CONSTANT_S = 1e-4
# Limit of (frequency x time)^2 below which sin(w t) / w is t: damping is then nearly critical.
CRITICAL_TOLERANCE = 1e-8
# Tolerance for rounding errors.
ROUNDING_TOLERANCE = 1e-9
# Maximum number of phases of a held command; some five are usual.
MAX_COMMAND_PHASES = 32
# Speed limit that never stops the shaft.
NO_STOP_RPM = -1e100
# Number of bisection steps of the time at which the acceleration limit is reached: enough for full
# precision.
BISECTION_STEPS = 50


class Shaft(NamedTuple):
    """Parameters of the shaft and of its effects."""

    dead_time_s: Annotated[float, Field(ge=0, le=600)] = 0.373
    time_constant_s: Annotated[float, Field(ge=1e-4, le=3600)] = 0.05
    acceleration_rpm_s: Annotated[float, Field(ge=0.1, le=1e7)] = 200.0
    nominal_supply_v: Annotated[float, Field(ge=1, le=60)] = 13.5
    full_opening_mm: Annotated[float, Field(ge=0.1, le=500)] = 60.0
    # 1 means that a command to turn backwards has no effect.
    one_way: Annotated[float, Field(ge=0, le=1)] = 0.0
    # Speed at which the saturation is defined, r/min.
    full_rpm: Annotated[float, Field(ge=0.1, le=1e5)] = 100.0
    # 1 means that the drive controls its speed by its own encoder.
    regulated: Annotated[float, Field(ge=0, le=1)] = 0.0
    # 0 means that a command of 0 is an ordinary command, which may turn the shaft.
    zero_stops: Annotated[float, Field(ge=0, le=1)] = 1.0
    dead_zone_rpm: Annotated[
        float,
        Field(ge=0, le=1e5),
        Effect(
            "shaft.dead_zone",
            "r/min",
            "Shaft turns too slowly, by the same at every speed",
            "Friction and the power stage take a constant part of every duty cycle away, "
            "either way.",
            "brushed motors by duty cycle: 5-25 % of the range",
            ("run",),
            "Let the drive hold its speed by an encoder, or adopt it: control then adds it "
            "to each command.",
            "A staircase of shaft commands over the whole range, settled at each.",
            probes=(1.0, 5.0, 15.0),
            bounds=(0.0, 60.0),
            scales_with=SHAFT_RANGE,
            says=("The shaft turns {size} r/min slower than commanded, at every speed.",),
        ),
    ] = 0.0
    saturation_percent: Annotated[
        float,
        Field(ge=0, le=95),
        Effect(
            "shaft.saturation",
            "% lost at full speed",
            "Shaft falls the further behind its command the faster it turns",
            "A motor's speed bends away from its duty cycle as load and the supply's "
            "resistance grow.",
            "robot and pump drives by duty cycle: 10-50 % at full speed",
            ("run",),
            "Let the drive hold its speed by an encoder, or adopt it: control then bends "
            "each command the other way.",
            "A staircase of shaft commands up to full speed, settled at each.",
            probes=(1.0, 5.0, 20.0),
            says=("The shaft falls {size} % short when it is to turn fastest.",),
        ),
    ] = 0.0
    neutral_rpm: Annotated[
        float,
        Field(ge=-2e5, le=2e5),
        Effect(
            "shaft.neutral",
            "r/min of command",
            "Shaft stands still at another command than zero",
            "A servo's pulse, a converter's middle voltage or an offset of the power stage "
            "moves the command at which "
            "nothing turns.",
            "servos: 1.5 ms of 1 to 2 ms; converters: 512 of 0 to 1023; offsets of power "
            "stages: a few per cent",
            ("run",),
            "Trim the drive's zero, or adopt it: control then adds it to each command.",
            "A staircase of shaft commands through the one at which it stands, down to zero.",
            probes=(1.0, 5.0),
            bounds=(-200.0, 200.0),
            scales_with=SHAFT_RANGE,
            says=(
                "The shaft stands still at a command of {size} r/min, and turns by what a "
                "command is beyond it.",
                "The shaft turns as if {size} r/min more were commanded.",
            ),
        ),
    ] = 0.0
    back_gain_percent: Annotated[
        float,
        Field(ge=-90, le=200),
        Effect(
            "shaft.back_gain",
            "%",
            "Shaft turns at another fraction of its command backwards than forwards",
            "Brushes that are set for one direction, and a load that helps or hinders, make "
            "a motor unlike either way.",
            "two-way motors: a few per cent, worn ones 10 %",
            ("run",),
            "Check the brushes' timing and what the load does backwards.",
            "The same staircase of commands forwards and backwards.",
            says=(
                "Backwards the shaft turns {size} % faster than forwards.",
                "Backwards the shaft turns {size} % slower than forwards.",
            ),
        ),
    ] = 0.0
    back_zone_rpm: Annotated[
        float,
        Field(ge=-1e5, le=1e5),
        Effect(
            "shaft.back_zone",
            "r/min",
            "Shaft loses another constant speed backwards than forwards",
            "Friction of bearings, brushes and gears is seldom the same either way.",
            "two-way motors by duty cycle: a few per cent of the range",
            ("run",),
            "Check bearings and gears for what rubs in one direction.",
            "The same staircase of small commands forwards and backwards.",
            probes=(1.0, 5.0),
            bounds=(-60.0, 60.0),
            scales_with=SHAFT_RANGE,
            says=(
                "Backwards the shaft loses {size} r/min more than forwards.",
                "Backwards the shaft loses {size} r/min less than forwards.",
            ),
        ),
    ] = 0.0
    # Below -100 %, the shaft turns faster as the command decreases.
    gain_percent: Annotated[
        float,
        Field(ge=-300, le=1900),
        Effect(
            "shaft.gain",
            "%",
            "Shaft turns too fast or too slow, always by the same share",
            "A wrong gear or encoder setting or a slipping belt scales every speed alike.",
            "drive ratio error; usual 1-10 %",
            ("run",),
            "Check the gear ratio in the drive's settings, the encoder's lines, the belt tension.",
            "A staircase of shaft commands at constant opening and supply.",
            says=(
                "The metering shaft turns {size} % faster than commanded.",
                "The metering shaft turns {size} % slower than commanded.",
                "The metering shaft turns the slower the higher its command is ({size} % "
                "less than commanded).",
            ),
        ),
    ] = 0.0
    slow_s: Annotated[
        float,
        Field(ge=-3600, le=3600),
        Effect(
            "shaft.slow",
            "s",
            "Shaft comes to its speed too slowly",
            "A weak or worn motor needs longer to reach the speed that it was sent.",
            "motor time constants near 0.3 s are published for such drives",
            ("run",),
            "Check brushes, supply cable and the drive's acceleration setting.",
            "Small and large steps of the shaft command up and down.",
            probes=(0.02,),
            bounds=(-5.0, 5.0),
            scales_with=LONGEST_ANSWER,
            says=(
                "The shaft takes {size} s longer than it should to come to its speed.",
                "The shaft comes to its speed {size} s sooner than its data sheet says.",
            ),
        ),
    ] = 0.0
    second_order_s: Annotated[
        float,
        Field(ge=0, le=3600),
        Effect(
            "shaft.second_order",
            "s",
            "Shaft answers in second order: it overshoots, or sets off gradually",
            "A speed controller tuned too tight swings beyond its command; a filter or a "
            "soft coupling holds the start "
            "back.",
            "motor with electrical time constant, or controller that integrates: T T2 s^2 + "
            "T s + 1 (Ogata 2010, ch. 5)",
            ("run",),
            "Where it overshoots: lower the gains of the speed controller. Where it sets "
            "off gradually: shorten its "
            "filter, tighten the coupling.",
            "Single steps of the shaft command, up and down, in rows of a tenth of the time "
            "that it takes to settle.",
            probes=(0.02, 0.3),
            bounds=(0.0, 5.0),
            scales_with=LONGEST_ANSWER,
            says=(
                "The shaft's speed follows through a second time constant of {size} s; "
                "beyond a quarter of the first it "
                "overshoots.",
            ),
        ),
    ] = 0.0
    ramp_s: Annotated[
        float,
        Field(ge=0, le=600),
        Effect(
            "shaft.ramp",
            "s to full speed",
            "Shaft changes its speed by a ramp, however large the step",
            "A drive's ramp setting, or a motor that gives all its torque, limits how fast "
            "its speed changes.",
            "frequency inverters and motor drivers: 0.5-30 s to full speed by their setting",
            ("run",),
            "Shorten the ramp in the drive's settings, or adopt it: control then knows how "
            "long a change takes.",
            "Small and large steps of the shaft command: by a ramp the large one takes longer.",
            probes=(0.05, 0.5),
            says=(
                "The shaft needs {size} s more from standstill to full speed, and as much "
                "of that for a part of "
                "it.",
            ),
        ),
    ] = 0.0
    extra_dead_time_s: Annotated[
        float,
        Field(ge=-600, le=1500),
        Effect(
            "shaft.dead_time",
            "s",
            "Shaft answers too late",
            "Bus, drive or firmware hold a command back before the motor sees it.",
            "lag paper, table 2: 0.383 s to 2 r/min",
            ("run", "response"),
            "Look at the bus cycle and the drive's filter setting.",
            "Steps of the shaft command, large and small: a dead time is the same for both.",
            probes=(0.01,),
            bounds=(-0.3, 2.0),
            scales_with=LONGEST_ANSWER,
            says=(
                "The shaft answers {size} s too late.",
                "The shaft answers {size} s sooner than expected.",
            ),
        ),
    ] = 0.0
    dead_band_rpm: Annotated[
        float,
        Field(ge=0, le=1e5),
        Effect(
            "shaft.dead_band",
            "r/min",
            "Shaft does not turn below some command",
            "Static friction holds the shaft until the duty cycle overcomes it.",
            "brushed motors with worm gears: 5-20 r/min",
            ("run",),
            "Grease the bearings, raise the drive's minimum duty.",
            "A slow ramp of the shaft command from zero.",
            probes=(5.0, 10.0, 15.0, 20.0, 30.0, 40.0),
            bounds=(0.0, 60.0),
            scales_with=SHAFT_RANGE,
            says=("The shaft does not turn at all below {size} r/min.",),
        ),
    ] = 0.0
    sag_percent_per_v: Annotated[
        float,
        Field(ge=0, le=30),
        Effect(
            "shaft.voltage_sag",
            "% lost per V",
            "Shaft loses speed when the supply falls below nominal",
            "An open-loop motor's speed follows its supply voltage.",
            "first-order motor equation: about 1/U per volt, 7 % at 13.5 V",
            ("run",),
            "Check battery, alternator and the voltage drop along the supply cable.",
            "The same shaft command with the engine idling and at rated speed.",
            says=("The shaft loses {size} % of its speed for every volt that the supply is low.",),
        ),
    ] = 0.0
    droop_percent: Annotated[
        float,
        Field(ge=0, le=60),
        Effect(
            "shaft.load_droop",
            "% lost at full opening",
            "Shaft loses speed as the opening, and with it the load, grows",
            "A wider opening shears more material, and the motor slows under the torque.",
            "open-loop motor under load",
            ("run",),
            "Check the motor's current limit; clean caked material from the rollers.",
            "A staircase of openings at one shaft command.",
            says=("With the gate fully open the shaft turns {size} % too slowly.",),
        ),
    ] = 0.0
    encoder_step_rpm: Annotated[
        float,
        Field(ge=0, le=1e4),
        Effect(
            "shaft.coarse_encoder",
            "r/min",
            "Measured shaft speed comes in steps",
            "Few encoder lines counted over a short gate give a speed in whole counts.",
            "60 / (lines x gate time)",
            ("run",),
            "Use an encoder with more lines, or measure the period instead of counting.",
            "A slow ramp of the shaft command.",
            probes=(0.5, 1.0, 2.0, 4.0),
            bounds=(0.0, 20.0),
            scales_with=SHAFT_RANGE,
            says=("The shaft's speed is measured in steps of {size} r/min only.",),
        ),
    ] = 0.0
    stalled: Annotated[
        float,
        Field(ge=0, le=1),
        Effect(
            "shaft.stall",
            "s",
            "Shaft stops at some time though commanded",
            "A jammed roller, a broken coupling or a tripped fuse stops the shaft.",
            "field experience",
            ("run",),
            "Switch off, clear the roller, check the coupling and the fuse.",
            "None needed: command on, shaft still.",
            probes=(1.0,),
            onset_only=True,
            says=("The shaft stopped {size} s into the run though it should have turned.",),
        ),
    ] = 0.0


class ShaftInput(NamedTuple):
    """Inputs of the shaft."""

    command_rpm: float
    opening_mm: float
    supply_v: float
    # Sum of the machine file's terms (`step_term`), %.
    more_percent: float = 0.0
    more_rpm: float = 0.0
    pitch_deg: float = 0.0


class ShaftState(NamedTuple):
    """State of the shaft."""

    time_s: float
    rpm: float
    line: DelayLine
    # Rate of change of the speed of a second-order shaft, r/min per second.
    rpm_s: float = 0.0


class ShaftOutput(NamedTuple):
    """Outputs of the shaft."""

    # True speed, r/min.
    rpm: float
    measured_rpm: float


def make_shaft_start(rpm: float = 0.0, time_s: float = 0.0) -> ShaftState:
    """Returns a shaft in a steady state at `rpm`, under a constant command."""
    return ShaftState(time_s, rpm, make_line(rpm))


def step_first_order(
    value: float, wanted: float, tau_s: float, fastest_per_s: float, dt_s: float
) -> float:
    """Returns the value of a first-order system with a limited slope, exact for a constant
    `wanted`: a ramp at the limit, then exponential."""
    gap = wanted - value
    if gap == 0.0:
        return value
    reach = fastest_per_s * tau_s
    left_s = dt_s
    if abs(gap) > reach:
        ramp_s = min(dt_s, (abs(gap) - reach) / fastest_per_s)
        value += fastest_per_s * ramp_s if gap > 0.0 else -fastest_per_s * ramp_s
        left_s = dt_s - ramp_s
    return wanted + (value - wanted) * exp(-left_s / tau_s)


def solve_free_response(
    x: float, v: float, tau_s: float, second_s: float, t: float
) -> tuple[float, float]:
    """Returns the solution of tau second x'' + tau x' + x = 0 after t from x, v; exact at any
    damping."""
    sigma, square = 0.5 / second_s, 1.0 / (tau_s * second_s)
    # A positive value means two time constants, a negative value an oscillation.
    beyond = sigma * sigma - square
    if abs(beyond) * t * t < CRITICAL_TOLERANCE:
        even, odd = exp(-sigma * t), t * exp(-sigma * t)
    elif beyond > 0.0:
        root = sqrt(beyond)
        slow, quick = exp(-square / (sigma + root) * t), exp(-(sigma + root) * t)
        even, odd = 0.5 * (slow + quick), 0.5 * (slow - quick) / root
    else:
        root = sqrt(-beyond)
        even, odd = exp(-sigma * t) * cos(root * t), exp(-sigma * t) * sin(root * t) / root
    return x * even + (v + sigma * x) * odd, v * even - (sigma * v + square * x) * odd


def find_next_zero_s(at: float, falls: float, tau_s: float, second_s: float) -> float:
    """Returns the time until a value of `solve_free_response`, now `at` and decreasing with
    `falls`, is next 0, s; 1e300 for never.

    The value is at C - falls S, where C and S are 1 and 0 now and S increases with 1.
    """
    sigma, square = 0.5 / second_s, 1.0 / (tau_s * second_s)
    beyond = sigma * sigma - square
    if abs(beyond) < CRITICAL_TOLERANCE * square:
        return (
            at / falls
            if at * falls > 0.0 and abs(at) > ROUNDING_TOLERANCE * abs(falls) * tau_s
            else 1e300
        )
    root = sqrt(abs(beyond))
    if beyond < 0.0:
        angle = atan2(root * at, falls)
        angle = angle if angle >= 0.0 else angle + pi
        # A zero that has just passed is not the next zero.
        return (angle if angle > ROUNDING_TOLERANCE else angle + pi) / root
    share = root * at / falls if falls != 0.0 else 0.0
    return (
        0.5 * log((1.0 + share) / (1.0 - share)) / root
        if ROUNDING_TOLERANCE < share < 1.0
        else 1e300
    )


def find_free_time_s(
    x: float,
    v: float,
    tau_s: float,
    second_s: float,
    fastest_per_s: float,
    room: float,
    left_s: float,
) -> float:
    """Returns how long `solve_free_response` is valid, s: until the slope reaches its limit or x
    reaches -room, at most `left_s`.

    The solution also ends where it reverses, because slopes and limits must then be examined again.
    """
    sigma, square = 0.5 / second_s, 1.0 / (tau_s * second_s)
    pull = sigma * v + square * x
    slope = -sigma * v - pull
    end_s = min(left_s, find_next_zero_s(slope, sigma * slope + square * v, tau_s, second_s))
    # Otherwise the value stays within the limit, because a free oscillation loses amplitude.
    swings = x * x + v * v / square > room * room
    if swings:
        end_s = min(end_s, find_next_zero_s(v, pull, tau_s, second_s))
    low, high = 0.0, end_s
    x_end, v_end = solve_free_response(x, v, tau_s, second_s, end_s)
    if abs(v_end) <= fastest_per_s * (1.0 + ROUNDING_TOLERANCE) and x_end >= -room * (
        1.0 + ROUNDING_TOLERANCE
    ):
        # The slope of a free oscillation is largest at its first reversal.
        return end_s if swings else left_s
    for _ in range(BISECTION_STEPS):
        middle = 0.5 * (low + high)
        x_end, v_end = solve_free_response(x, v, tau_s, second_s, middle)
        if abs(v_end) > fastest_per_s or x_end < -room:
            high = middle
        else:
            low = middle
    return high


def step_second_order(
    value: float,
    rate: float,
    wanted: float,
    tau_s: float,
    second_s: float,
    fastest_per_s: float,
    least: float,
    dt_s: float,
) -> tuple[float, float]:
    """Returns value and rate of a second-order system with a limited slope after `dt_s`, exact for
    a constant `wanted`.

    tau second x'' + tau x' + x = wanted, x' within +-fastest: a ramp at the limit, and a free
    response otherwise. The value stops at `least`.
    """
    x, v, left_s, room = (
        value - wanted,
        min(fastest_per_s, max(-fastest_per_s, rate)),
        dt_s,
        wanted - least,
    )
    for _ in range(MAX_COMMAND_PHASES):
        if left_s <= 0.0:
            break
        way = 1.0 if v > 0.0 else -1.0
        ramp_s = (-way * x - fastest_per_s * tau_s) / fastest_per_s
        if abs(v) >= fastest_per_s and ramp_s > ROUNDING_TOLERANCE * tau_s:
            ramp_s = min(ramp_s, left_s)
            x, v, left_s = x + way * fastest_per_s * ramp_s, way * fastest_per_s, left_s - ramp_s
            continue
        free_s = find_free_time_s(x, v, tau_s, second_s, fastest_per_s, room, left_s)
        x, v = solve_free_response(x, v, tau_s, second_s, free_s)
        v, left_s = min(fastest_per_s, max(-fastest_per_s, v)), left_s - free_s
        if x < -room:
            x, v = -room, 0.0
    return wanted + x, v


class StepResponse(NamedTuple):
    """Holds the response to a small step of the command. overshoot_percent: of the step. period_s:
    of the oscillation.

    lags_s: the two time constants; an oscillation has a single one, that of its decay.
    """

    overshoot_percent: float
    period_s: float
    lags_s: tuple[float, ...]


def calc_step_response(p: Shaft) -> StepResponse:
    """Returns the step response of a second-order shaft (Ogata, Modern Control Engineering,
    2010, 5-3: damping ratio sqrt(T / T2) / 2)."""
    tau_s, second_s = calc_time_constant_s(p), p.second_order_s
    square, sigma = 1.0 / (tau_s * second_s), 0.5 / second_s
    beyond = sigma * sigma - square
    if beyond < 0.0:
        root = sqrt(-beyond)
        return StepResponse(100.0 * exp(-pi * sigma / root), 2.0 * pi / root, (1.0 / sigma,))
    quick = sigma + sqrt(beyond)
    return StepResponse(0.0, 0.0, (quick / square, 1.0 / quick))


def follow_command(
    p: Shaft, value: float, rate: float, wanted: float, dt_s: float
) -> tuple[float, float]:
    """Returns speed and slope after `dt_s` of a shaft with the target speed `wanted`."""
    if p.second_order_s <= 0.0:
        return step_first_order(
            value, wanted, calc_time_constant_s(p), calc_acceleration_rpm_s(p), dt_s
        ), 0.0
    least = 0.0 if p.one_way > 0.0 and value >= 0.0 and wanted >= 0.0 else NO_STOP_RPM
    return step_second_order(
        value,
        rate,
        wanted,
        calc_time_constant_s(p),
        p.second_order_s,
        calc_acceleration_rpm_s(p),
        least,
        dt_s,
    )


def calc_time_constant_s(p: Shaft) -> float:
    """Returns the time constant of the shaft, s: a drive may be faster than its data sheet, but
    the time is never negative."""
    return max(MIN_TIME_CONSTANT_S, p.time_constant_s + p.slow_s)


def calc_acceleration_rpm_s(p: Shaft) -> float:
    """Returns the acceleration limit of the shaft, r/min per second: the times of limit and ramp
    to full speed are added."""
    return 1.0 / (1.0 / p.acceleration_rpm_s + p.ramp_s / p.full_rpm)


def calc_dead_time_s(p: Shaft) -> float:
    """Returns the time from a command to the shaft's first movement, s."""
    return max(0.0, p.dead_time_s + p.extra_dead_time_s)


def calc_effective_command_rpm(p: Shaft, command_rpm: float) -> float:
    """Returns the difference of a command from the command at which the shaft stands, r/min; a
    negative result turns the shaft backwards.

    Where the speed decreases with the command (a gain below -100 %), the sign is reversed. A
    command of 0 stops a shaft with `zero_stops`.
    """
    if command_rpm == 0.0 and p.zero_stops > 0.0:
        return 0.0
    beyond = command_rpm - p.neutral_rpm
    return -beyond if p.gain_percent < -100.0 else beyond


def calc_settled_rpm(p: Shaft, beyond: float) -> float:
    """Returns the magnitude of the steady speed for an effective command
    (`calc_effective_command_rpm`), r/min, before the factors on every speed.

    A threshold stops the shaft until the command exceeds it; a dead zone is subtracted from every
    command: g (u - D). The curve saturates smoothly, u / (1 + k u / full), because the current of a
    motor is interrupted more often at a higher duty cycle.
    """
    size = abs(beyond)
    if size < p.dead_band_rpm or (beyond < 0.0 and p.one_way > 0.0):
        return 0.0
    if beyond < 0.0:
        size = max(0.0, size - max(0.0, p.dead_zone_rpm + p.back_zone_rpm)) * (
            1.0 + p.back_gain_percent / 100.0
        )
    else:
        size = max(0.0, size - p.dead_zone_rpm)
    if p.saturation_percent == 0.0:
        return size
    return size / (1.0 + p.saturation_percent / (100.0 - p.saturation_percent) * size / p.full_rpm)


def calc_speed_factor(p: Shaft, u: ShaftInput) -> float:
    """Returns the factor on every speed of the shaft, without terms; metering divides by it."""
    short_v = p.nominal_supply_v - u.supply_v
    sag = p.sag_percent_per_v * short_v if short_v > 0.0 else 0.0
    droop = p.droop_percent * u.opening_mm / p.full_opening_mm
    return abs(1.0 + p.gain_percent / 100.0) * (1.0 - sag / 100.0) * (1.0 - droop / 100.0)


def step_shaft(
    p: Shaft, s: ShaftState, u: ShaftInput, dt_s: float
) -> tuple[ShaftState, ShaftOutput]:
    """Advances the shaft by one step of `dt_s` with constant inputs; the outputs are those at its
    end.

    Nominal: dead time, first order with an acceleration limit; together 0.383 s to 2 r/min for any
    set-point from 10 r/min up (lag paper, table 2).
    """
    late_s = calc_dead_time_s(p)
    turns = calc_speed_factor(p, u) * (1.0 + u.more_percent / 100.0)
    turns = turns * (1.0 - p.stalled) if turns > 0.0 else 0.0
    line = put_in_line(s.line, s.time_s, u.command_rpm)
    rpm, rate, at_s, end_s = s.rpm, s.rpm_s, s.time_s - late_s, s.time_s - late_s + dt_s
    while at_s < end_s:
        line, wanted, until_s = read_held_line(line, at_s, end_s)
        beyond = calc_effective_command_rpm(p, wanted)
        goal = turns * calc_settled_rpm(p, beyond)
        # Terms have the sign of the speed; no term reverses it.
        if goal > 0.0:
            way = -1.0 if beyond < 0.0 else 1.0
            goal = way * max(0.0, goal + way * u.more_rpm)
        rpm, rate = follow_command(p, rpm, rate, goal, until_s - at_s)
        at_s = until_s
    return ShaftState(s.time_s + dt_s, rpm, line, rate), ShaftOutput(
        rpm, round_to_step(rpm, p.encoder_step_rpm)
    )

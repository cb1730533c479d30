"""Logs of a drive alone, none of our model's making: real ones of a test rig look so."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from topdress.console.reports.diagnosis_text import summarise_terminal
from topdress.console.reports.diagnosis_wording import format_verdict_line
from topdress.control.diagnosis import diagnose_run, extend
from topdress.control.diagnosis.judgement.checks import calc_correlation_p
from topdress.control.diagnosis.runs.quantised import find_reading_step
from topdress.control.machine.machine import Machine, Noise, Tolerance
from topdress.control.recordings.valid_values import blank_outliers
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

from tests.diagnosis.logs import DRIVE, Columns, Rng, drive, followed, lagged, settled
from tests.diagnosis.planted import Between, error_on, found_as_planted, planted

approx = pytest.approx
ALONE: Machine = load_config("drive_alone", MACHINE_KIND).model


def sheet(tau_s: float, noise_rpm: float = 10.0) -> Machine:
    """Up to 1000 r/min, at once, within usual tolerances."""
    return drive(
        1000.0,
        noise_rpm,
        tolerance=Tolerance(shaft_percent=0.5, dead_time_s=0.01, time_constant_s=0.015),
        dead_time_s=0.0,
        time_constant_s=tau_s,
    )


def motor(noise_rpm: float, **shaft: float) -> Machine:
    return DRIVE.model_copy(
        update={"shaft": DRIVE.shaft._replace(**shaft), "noise": Noise(shaft_rpm=noise_rpm)}
    )


def a_log(step_s: float, command: Any, speed: Any) -> Columns:
    return {
        "time_s": step_s * np.arange(len(command)),
        "shaft_rpm_cmd": command,
        "shaft_rpm": speed,
    }


# --- Ramps
# --------------------------------------------------------------------------------------------------

RAMPED = drive(1000.0, 3.0, dead_time_s=0.0, time_constant_s=0.05)


def ramped(seed: int, ramp_s: float, slow_s: float = 0.0) -> Columns:
    """Steps of all sizes, each held for three seconds; by an even ramp and a first order, in
    fine steps."""
    rng, fine = np.random.default_rng(seed), 50
    command = np.repeat(rng.uniform(50.0, 950.0, 60).round(), 60)
    most = 1000.0 / ramp_s * 0.05 / fine if ramp_s > 0.0 else np.inf
    speed = followed(np.repeat(command, fine), 0.05 / fine / (0.05 + slow_s), most)[::fine]
    return a_log(0.05, command, speed + 3.0 * rng.standard_normal(len(command)))


@pytest.mark.exam
@pytest.mark.parametrize("ramp_s", [0.6, 2.0])
def test_a_ramp_is_named_with_its_size(ramp_s: float) -> None:
    found = diagnose_run(ramped(3, ramp_s), RAMPED)
    ramp = next(one for one in found.causes if one.id == "shaft.ramp")
    assert found.verdict == "named" and ramp.probability > 0.9
    assert ramp.size.value == approx(ramp_s, rel=0.05)
    assert extend(RAMPED, found).shaft.ramp_s == approx(ramp_s, rel=0.05)


# --- What logs of real drives have: rows far apart, loud readings, a clock that jitters, a unit
# of its own -----------


def hunting() -> Columns:
    """A speed loop that hunts: the target stands still, the wheel swings by a fifth of it."""
    time_s = np.arange(0.0, 12.0, 0.011)
    swing = lfilter(
        [1.0], [1.0, -1.9, 0.905], np.random.default_rng(7).standard_normal(len(time_s))
    )
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": np.full(len(time_s), 200.0),
        "shaft_rpm": 200.0 + 45.0 * swing / np.std(swing),
    }


def stairs_below_its_threshold(said: bool) -> Columns:
    """A staircase of 10 r/min, a row a step: 1.1 s apart; the drive does not turn below 120
    r/min."""
    stairs = np.tile(np.arange(20.0, 660.0, 10.0), 2)
    noise = 2.0 * np.random.default_rng(3).standard_normal(len(stairs))
    return settled(stairs, np.where(stairs < 120.0, 0.0, stairs + noise), said=said)


def one_staircase() -> Columns:
    """26 settings with their settled answers, as a calibration of a wheel is written; 100 r/min
    of each are lost."""
    stairs = np.arange(0.0, 650.0, 25.0)
    return settled(
        stairs,
        np.maximum(0.0, stairs - 100.0) + np.random.default_rng(2).standard_normal(len(stairs)),
    )


def sweep() -> Columns:
    """A sweep of the command, a row a second, of a drive that answers within 0.6 s."""
    asked_rpm = np.tile(
        np.concatenate((np.arange(10.0, 640.0, 15.0), np.arange(640.0, 10.0, -15.0))), 3
    )
    return settled(
        asked_rpm,
        0.9 * asked_rpm + np.random.default_rng(5).standard_normal(len(asked_rpm)),
        row_s=1.0,
    )


def long_healthy() -> Columns:
    rng = np.random.default_rng(2)
    asked_rpm = np.repeat(rng.uniform(60.0, 600.0, 120), 20)
    noise = 2.0 * rng.standard_normal(len(asked_rpm))
    return a_log(
        0.05, asked_rpm, lagged(np.concatenate((asked_rpm[:1], asked_rpm[:-1])), 0.06, 0.05) + noise
    )


def at_once(held_rows: int, rows: int, seed: int, times: float = 1.0) -> Columns:
    """A drive that does in each row what the row before asked, with so many times the noise of
    its file."""
    rng = np.random.default_rng(seed)
    asked_rpm = commands(rng, rows, held_rows)
    noise = times * 10.0 * rng.standard_normal(rows)
    return a_log(0.5, asked_rpm, np.concatenate((asked_rpm[:1], asked_rpm[:-1])) + noise)


def commands(rng: Rng, rows: int, held_rows: int) -> Any:
    return np.repeat(rng.uniform(100.0, 950.0, rows // held_rows + 1), held_rows)[:rows].round()


def overshooting() -> Columns:
    """Of second order, a third beyond each command, read in steps of 8: what it leaves comes
    after its moves."""
    rng, step_s, fine = np.random.default_rng(5), 0.02, 20
    asked_rpm = commands(rng, 3000, 50)
    speed, slope, read = asked_rpm[0], 0.0, []
    for asked in asked_rpm:
        read.append(speed)
        for _ in range(fine):
            slope += (
                ((2.0 * np.pi / 0.25) ** 2 * (asked - speed) - 0.66 * 2.0 * np.pi / 0.25 * slope)
                * step_s
                / fine
            )
            speed += slope * step_s / fine
    return a_log(
        step_s, asked_rpm, 8.0 * np.round((np.array(read) + 2.0 * rng.standard_normal(3000)) / 8.0)
    )


def geared(gear: float) -> Columns:
    """Commands of the motor up to 950 r/min and the speed of the wheel behind a gear."""
    rng, rows = np.random.default_rng(7), 1500
    asked_rpm = commands(rng, rows, 15)
    return a_log(
        0.5,
        asked_rpm,
        np.concatenate((asked_rpm[:1], asked_rpm[:-1]))
        / gear
        * (1.0 + 0.01 * rng.standard_normal(rows)),
    )


def braked(seed: int) -> Columns:
    """A drive at one command that a hand brakes, by hand in three grips, and a load cell with
    stray cells."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, 66.0, 0.091)
    load_g = np.zeros(len(time_s))
    for begin_s, end_s, grip_g in ((24.0, 38.0, 200.0), (38.0, 53.0, 390.0), (52.5, 53.5, 900.0)):
        load_g += grip_g * np.clip((time_s - begin_s) / 1.5, 0.0, 1.0) * (time_s < end_s)
    load_g += 15.0 * np.sin(time_s * 3.1) * (load_g > 0.0) + 3.0 * rng.standard_normal(len(time_s))
    speed = 860.0 - 0.09 * load_g + 7.0 * rng.standard_normal(len(time_s))
    at = rng.choice(len(time_s) - 2, 12, replace=False)
    load_g[at] = -960.0
    load_g[at[0]] = -383776.0
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": np.full(len(time_s), 900.0),
        "shaft_rpm": speed,
        "load_g": load_g,
        "motor_c": 40.0 + 0.05 * np.cumsum(rng.standard_normal(len(time_s))) * 0.1,
    }


def off_zero(
    seed: int, goal: Callable[[Any], Any], low: float, high: float, stops: float = 0.0
) -> Columns:
    """Commands held for a second, so many of them 0; each row goes on from the one before to
    what `goal` says."""
    rng = np.random.default_rng(seed)
    asked_rpm = commands_between(rng, low, high)
    asked_rpm[np.repeat(rng.random(120) < stops, 50)] = 0.0
    wanted = goal(asked_rpm)
    read = lagged(np.concatenate((wanted[:1], wanted[:1], wanted[:-2])), 0.06, 0.02)
    return a_log(0.02, asked_rpm, read + 2.0 * rng.standard_normal(len(read)))


def commands_between(rng: Rng, low: float, high: float) -> Any:
    return np.repeat(rng.uniform(low, high, 120), 50).round(1)


# What a drive does with a command: its goal, the least and the largest command, what stands at
# 0, the names and sizes.
OFF_ZERO: list[tuple[str, Callable[[Any], Any], float, float, float, dict[str, float]]] = [
    (
        "an offset",
        lambda u: 24.0 + 1.05 * u,
        0.0,
        600.0,
        0.15,
        {"shaft.neutral": -22.86, "shaft.gain": 5.0},
    ),
    (
        "an offset, never commanded to stop",
        lambda u: 35.0 + 1.04 * u,
        60.0,
        600.0,
        0.0,
        {"shaft.neutral": -33.65, "shaft.gain": 4.0},
    ),
    (
        "a servo about its middle",
        lambda u: 1.2 * (u - 300.0),
        60.0,
        540.0,
        0.0,
        {"shaft.neutral": 300.0, "shaft.gain": 20.0},
    ),
    (
        "a middle with a zone about it",
        lambda u: 1.2 * np.sign(u - 300.0) * np.maximum(0.0, abs(u - 300.0) - 25.0),
        20.0,
        640.0,
        0.0,
        {"shaft.neutral": 300.0, "shaft.gain": 20.0, "shaft.dead_zone": 25.0},
    ),
    (
        "slower the higher its command",
        lambda u: 560.0 - 1.1 * u,
        20.0,
        500.0,
        0.0,
        {"shaft.gain": -210.0, "shaft.neutral": 509.1},
    ),
]


@pytest.mark.parametrize(
    ("goal", "low", "high", "stops", "sizes"),
    [
        pytest.param(*of, id=words, marks=[pytest.mark.exam] * ("servo" not in words))
        for words, *of in OFF_ZERO
    ],
)
@pytest.mark.exam
def test_a_drive_that_stands_at_another_command_than_zero(
    goal: Callable[[Any], Any], low: float, high: float, stops: float, sizes: dict[str, float]
) -> None:
    found = diagnose_run(off_zero(3, goal, low, high, stops), DRIVE)
    assert found.verdict == "named" and {one.id for one in found.causes} == set(sizes)
    assert all(one.size.value == approx(sizes[one.id], rel=0.03) for one in found.causes), (
        found.causes
    )
    of_file = extend(DRIVE, found)
    other = off_zero(4, goal, low, high)
    assert error_on(other, of_file) < 0.05 * error_on(other, DRIVE)


@pytest.mark.parametrize(
    ("goal", "names"),
    [
        pytest.param(lambda u: u, set(), id="nothing"),
        pytest.param(
            lambda u: 1.1 * np.maximum(0.0, u - 60.0),
            {"shaft.gain", "shaft.dead_zone"},
            id="a dead zone",
            marks=pytest.mark.exam,
        ),
        pytest.param(
            lambda u: u / (1.0 + 0.25 * u / 650.0),
            {"shaft.saturation"},
            id="a curve",
            marks=pytest.mark.exam,
        ),
    ],
)
@pytest.mark.exam
def test_what_stands_at_zero_has_no_neutral_point(
    goal: Callable[[Any], Any], names: set[str]
) -> None:
    for stops in (0.0, 0.15):
        assert {
            one.id for one in diagnose_run(off_zero(5, goal, 20.0, 600.0, stops), DRIVE).causes
        } == names


@pytest.mark.exam
def test_a_command_of_zero_that_turns_it_is_said_where_the_file_says_that_it_stops() -> None:
    log = off_zero(3, lambda u: 24.0 + 1.05 * u, 0.0, 600.0, 0.15)
    at_zero = [one for one in diagnose_run(log, DRIVE).findings if "shaft.zero_stops" in one]
    assert len(at_zero) == 1 and "left out" in at_zero[0]
    turns = DRIVE.model_copy(update={"shaft": DRIVE.shaft._replace(zero_stops=0.0)})
    found = diagnose_run(log, turns)
    assert not [one for one in found.findings if "shaft.zero_stops" in one]
    assert error_on(log, extend(turns, found)) < 2.5, "rows that command 0 are predicted, too"


OTHER_NOISE, BOTH_IN_RPM = "times the machine file's noise", "are both in r/min"


@pytest.mark.parametrize(
    ("log", "machine", "said"),
    [
        planted("no ramp", partial(ramped, 4, 0.0), RAMPED, names=[]),
        planted("slow, and no ramp", partial(ramped, 4, 0.0, 0.2), RAMPED, names=["shaft.slow"]),
        planted(
            "settings however far apart",
            partial(stairs_below_its_threshold, True),
            ALONE,
            exam=True,
            names=["shaft.dead_band"],
            sizes={"shaft.dead_band": approx(115.0, abs=5.0)},
        ),
        planted(
            "rows far apart of which nobody says that they are settled",
            partial(stairs_below_its_threshold, False),
            ALONE,
            exam=True,
            verdict="not_judged",
        ),
        planted(
            "one staircase up is a log",
            one_staircase,
            ALONE,
            verdict=("named", "ambiguous", "unexplained"),
            channels=["shaft"],
        ),
        planted("a long healthy log", long_healthy, motor(2.0, dead_time_s=0.05), verdict="none"),
        *(
            planted(
                f"a converter that overshoots is no coarse encoder, noise {noise_rpm:g} r/min",
                overshooting,
                sheet(0.05, noise_rpm),
                verdict="unexplained",
                unexplained=[("shaft", "shaft_rpm")],
            )
            for noise_rpm in (10.0, 30.0)
        ),
        planted(
            "a noise that the file allows",
            partial(at_once, 20, 2000, 6),
            sheet(0.01),
            exam=True,
            verdict="none",
            never_says=OTHER_NOISE,
        ),
        planted(
            "a noise that the file does not allow",
            partial(at_once, 20, 2000, 6, 3.0),
            sheet(0.01),
            verdict="none",
            says=OTHER_NOISE,
        ),
        planted(
            "readings far louder than the machine file says",
            hunting,
            ALONE,
            exam=True,
            verdict="unexplained",
            first_left={"channel": "shaft", "noise": approx(2.0), "rms": Between(30.0)},
        ),
        planted(
            "settled answers say nothing of dynamics",
            sweep,
            "drive_alone",
            names=["shaft.gain"],
            not_shown={"shaft.slow", "shaft.dead_time"},
        ),
        # No fault of the drive is sure where its wheel may be behind a gear.
        *(
            planted(
                f"a gear of {gear:g} raises a doubt of units",
                partial(geared, gear),
                sheet(0.01, 10.0 / gear),
                verdict=("none", "ambiguous", "unexplained"),
                says=BOTH_IN_RPM,
                probabilities=Between(high=0.2),
            )
            for gear in (25.0, 0.04)
        ),
        *(
            planted(
                f"a gear of {gear:g} may be a fault",
                partial(geared, gear),
                sheet(0.01, 10.0 / gear),
                verdict="named",
                never_says=BOTH_IN_RPM,
                has=("shaft.gain", "shaft.saturation"),
            )
            for gear in (1.3, 0.8)
        ),
        *(
            planted(
                f"a hand on the brake {seed}, a time constant of {tau_s:g} s",
                partial(braked, seed),
                sheet(tau_s),
                exam=seed != 1,
                verdict="unexplained",
                variables={"load_g"},
                says_of=("load_g", "not used"),
            )
            for tau_s in (0.05, 5.0)
            for seed in (1, 2)
        ),
    ],
)
def test_what_is_planted_is_said(
    log: Callable[[], Columns], machine: Machine, said: Mapping[str, Any]
) -> None:
    found_as_planted(log, machine, said)


def test_a_short_log_that_is_off_all_along_is_not_called_noise() -> None:
    time_s = np.arange(0.0, 6.0, 0.01)
    read = 267.0 + 2.0 * np.random.default_rng(8).standard_normal(len(time_s))
    found = diagnose_run(
        {"time_s": time_s, "shaft_rpm_cmd": np.full(len(time_s), 300.0), "shaft_rpm": read}, ALONE
    )
    assert found.verdict != "none"
    assert found.verdict in ("named", "ambiguous") or found.unexplained[0].hint == "shaft.gain"


def test_a_set_point_that_is_not_reached_is_not_called_healthy() -> None:
    """1.5 s at one set-point: it overshoots, then stands at so much of it. A log that could not
    show a usual fault."""
    time_s = np.arange(0.0, 1.5, 0.01)
    read = 86.0 + (
        40.0 * np.exp(-time_s / 0.05) + 8.0 * np.random.default_rng(1).standard_normal(len(time_s))
    )
    found = diagnose_run(a_log(0.01, np.full(len(time_s), 100.0), read), motor(5.6))
    assert found.verdict != "none"
    if found.verdict == "not_judged":
        assert found.channels and any(
            "shaft.gain" in note and "would not show" in note for note in found.findings
        )
        assert (
            "too short" in format_verdict_line(found)
            and "too short" in summarise_terminal(found)[0]
        )


def test_fewer_rows_than_a_log_has_are_refused() -> None:
    log = {name: values[1:] for name, values in one_staircase().items() if name != "events"}
    with pytest.raises(ValueError, match="at least 40"):
        diagnose_run(log, "drive_alone")


def test_steps_of_an_encoder_are_seen_through_a_clock_that_jitters() -> None:
    rng = np.random.default_rng(9)
    counts, jitter = rng.integers(14, 19, 600), 1.0 + 1e-4 * rng.integers(-3, 4, 600)
    found = find_reading_step(np.round(16.667 * counts * jitter, 2))
    assert found is not None and found.step_rpm == approx(16.667, rel=0.001)
    assert find_reading_step(np.round(rng.uniform(200.0, 300.0, 4000), 2)) is None


# --- A recorded variable is never overlooked
# -------------------------------------------------------------------------


def test_lone_cells_lose_their_weight_and_nothing_else_does() -> None:
    rng = np.random.default_rng(3)
    quiet = np.cumsum(rng.standard_normal(2000)) * 0.02 + 13.0
    spoilt = quiet.copy()
    spoilt[[100, 700, 701, 1500]] = [0.0, 99.0, 98.0, -4000.0]
    findings: list[Any] = []
    mended = blank_outliers("supply_v", spoilt, findings)
    assert np.flatnonzero(np.isnan(mended)).tolist() == [100, 700, 701, 1500]
    assert [one.id for one in findings] == ["lone"] and findings[0].rows == 4
    # switches, and stays for five rows
    steps = np.repeat(rng.integers(0, 2, 400), 5).astype(float)
    # of one row: all that the column ever says
    pulses = (rng.random(2000) < 0.02).astype(float)
    for real in (
        quiet,
        rng.standard_normal(2000),
        rng.standard_t(5, 2000),
        steps,
        pulses,
        np.round(quiet, 1),
    ):
        assert np.isnan(blank_outliers("x", real, [])).mean() < 0.002


def test_by_chance_as_often_as_it_says() -> None:
    """Of pairs that have nothing to do with each other, also where each remembers: one in a
    hundred at 0.01."""
    rng, refused = np.random.default_rng(4), 0
    for memory in (0.0, 0.5, 0.9):
        for _ in range(400):
            one, other = (
                np.convolve(rng.standard_normal(700), memory ** np.arange(60))[60:660]
                for _ in range(2)
            )
            refused += calc_correlation_p(one, other) < 0.01
    # of 1200: 12 +- 3.4, and the pairs left are an estimate
    assert 2 <= refused <= 30
    line = np.linspace(0.0, 1.0, 600)
    assert (
        calc_correlation_p(line + 0.3 * rng.standard_normal(600), rng.standard_normal(600)) > 0.01
    )
    # held, and read to a tenth
    turns = 1.0006 * np.repeat(np.round(rng.uniform(30.0, 70.0, 300), 1), 100)
    read = np.round(turns + 0.24 * rng.standard_normal(len(turns)), 1)
    assert calc_correlation_p(read - turns, turns) > 0.01
    white = rng.standard_normal(600)
    assert calc_correlation_p(white, np.exp(white) + rng.standard_normal(600)) < 1e-6

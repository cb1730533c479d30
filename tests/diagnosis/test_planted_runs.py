"""Run logs of whole machines, made by the compiled model, with and without something wrong,
from columns to verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.runs import grid
from topdress.control.diagnosis.runs.diagnose import Cancelled, diagnose_run
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.diagnosis.runs.log import clean_run_log
from topdress.control.diagnosis.runs.model import list_nuisances
from topdress.control.diagnosis.runs.report import find_separation
from topdress.control.diagnosis.runs.stages import make_run_data
from topdress.control.experiments.manoeuvres import list_manoeuvres
from topdress.control.machine.machine import CATALOGUE, Machine, list_effect_sizes
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

from tests.diagnosis.logs import (
    HUANGHAI,
    Columns,
    drive_run,
    held,
    metering_run,
    planted_in,
    taken,
    whole_run,
    wrong,
)
from tests.diagnosis.planted import check, found_as_planted, planted

approx = pytest.approx


def of_effects(effects: dict[str, float], exam: bool = True) -> Any:
    """Effects of the catalogue are named with their sizes, and nothing else is."""
    short = all(effect.startswith(("shaft", "gate")) for effect in effects)
    return planted(
        "+".join(effects),
        partial(whole_run, 5, 500.0 if short else 900.0, wrong(effects)),
        exam=exam,
        names=effects,
        sizes={name: approx(size, rel=0.15) for name, size in effects.items()},
    )


def late_gnss() -> Columns:
    """The wheel's reading, made in rows, is 0.1 s late itself."""
    return planted_in(
        whole_run(5),
        speed_mps=lambda c: (
            1.3
            + 0.2 * np.sin((c.time_s - 0.4) / 7.0)
            + 0.03 * np.random.default_rng(2).standard_normal(len(c.time_s))
        ),
    )


def engine_torque() -> Columns:
    log = whole_run(33)
    torque = 300.0 + 10.0 * held(np.random.default_rng(3), log["time_s"], 0.0, 8.0, 15.0)
    return planted_in(
        log, wheel_speed_mps=lambda c: c.wheel_speed_mps * (1.0 + 0.0003 * (torque - 300.0))
    ) | {"x_engine_torque_nm": torque, "x_fan_rpm": np.roll(torque, 1500)}


def oil_temperature() -> Columns:
    """A dependence that is as slow as the drift, and gains far more than over any other course
    of its column."""
    log, rng = whole_run(43, 1500.0), np.random.default_rng(43)
    heat, drift = (
        lfilter([1.0], [1.0, -np.exp(-0.1 / kept_s)], rng.standard_normal(len(log["time_s"])))
        for kept_s in (60.0, 120.0)
    )
    heat = 60.0 + 10.0 * heat / np.std(heat)
    return planted_in(
        log,
        x_oil_temperature_c=lambda c: heat,
        shaft_rpm=lambda c: (
            c.shaft_rpm * (1.0 + 0.0006 * (heat - 60.0)) + 0.2 * drift / np.std(drift)
        ),
    )


def rows_missing() -> Columns:
    log = whole_run(13, 500.0, wrong({"shaft.load_droop": 5.0}))
    return taken(log, np.random.default_rng(1).random(len(log["time_s"])) > 0.05)


def small_moves(
    seconds: float, low: float, high: float, hold_s: float, stuck_from_s: float
) -> Columns:
    """Moves that are asked of a gate at 25 mm, and done to the end, until it sticks, or not at
    all."""
    log = whole_run(18, seconds, still_opening=True)
    rng, time_s = np.random.default_rng(3), log["time_s"]
    command = held(rng, time_s, low, high, hold_s)
    if stuck_from_s > 0.0:
        where = np.where(time_s > stuck_from_s, command[time_s <= stuck_from_s][-1], command)
        log["opening_mm"] = where + 0.1 * rng.standard_normal(len(command))
    return log | {"opening_mm_cmd": command}


def rolling(shorter: Callable[[Any], Any], noise_seed: int, louder: float = 0.0) -> Columns:
    """A wheel that rolls shorter by a function of the roll, which is read with noise."""
    log, noise = whole_run(11), np.random.default_rng(noise_seed)
    roll = 4.0 * np.sin(log["time_s"] / 23.0)
    log["roll_deg"] = roll + 0.05 * noise.standard_normal(len(roll))
    log["wheel_speed_mps"] = log["wheel_speed_mps"] * shorter(roll)
    if louder:
        log["wheel_speed_mps"] = log["wheel_speed_mps"] + louder * noise.standard_normal(len(roll))
    return log


def pulses_missing_for_a_while() -> Columns:
    """They come in some classes of a slow column more than in others, and far more so in some
    of time."""
    log, rng = whole_run(11), np.random.default_rng(4)
    time_s = log["time_s"]
    log["roll_deg"] = 3.0 * np.sin(time_s / 60.0) + 0.3 * rng.standard_normal(len(time_s))
    dips = (rng.random(len(time_s)) < 0.1) & (time_s > 200.0) & (time_s < 330.0)
    return planted_in(log, wheel_speed_mps=lambda c: np.where(dips, 0.5, 1.0) * c.wheel_speed_mps)


CASES = [
    of_effects({"shaft.slow": 0.12, "gate.backlash": 0.8}, exam=False),
    of_effects({"scale.tilt": 0.2}),
    of_effects({"shaft.gain": 1.5, "gate.home_error": 0.4}),
    of_effects({"shaft.dead_time": 0.1, "gate.slow": 6.0}),
    of_effects({"shaft.voltage_sag": 2.0, "flow.fill_falloff": 12.0}),
    of_effects({"shaft.load_droop": 4.0, "flow.slope": 1.0}),
    planted(
        "a droop in a log of 1 Hz, and no gain",
        lambda: taken(
            whole_run(1, 1800.0, wrong({"shaft.load_droop": 6.0})), slice(None, None, 10)
        ),
        names=["shaft.load_droop"],
        sizes={"shaft.load_droop": approx(6.0, abs=0.3)},
    ),
    planted(
        "a dead time just beyond what its file allows is ahead of nothing",
        partial(whole_run, 5, 600.0, wrong({"shaft.dead_time": -0.032}, HUANGHAI)),
        HUANGHAI,
        verdict="none",
    ),
    planted(
        "a late GNSS speed",
        late_gnss,
        exam=True,
        names=["speed.gnss_latency"],
        sizes={"speed.gnss_latency": approx(0.3, abs=0.05)},
    ),
    planted(
        "a wrong read-back shows in gate and flow at once",
        partial(whole_run, 6, machine=wrong({"gate.offset": 0.5})),
        exam=True,
        names=["gate.offset"],
        rivals=[],
    ),
    planted(
        "a further column",
        engine_torque,
        exam=True,
        verdict="unexplained",
        unexplained=[("speed", "x_engine_torque_nm")],
    ),
    planted(
        "a further column along with a drift",
        oil_temperature,
        exam=True,
        unexplained=[("shaft", "x_oil_temperature_c")],
    ),
    planted(
        "one stage without the columns of others",
        lambda: {
            name: column
            for name, column in whole_run(34, machine=wrong({"shaft.slow": 0.3})).items()
            if name in ("time_s", "shaft_rpm_cmd", "shaft_rpm")
        },
        exam=True,
        names=["shaft.slow"],
        channels=["shaft"],
    ),
    *(
        planted(
            f"healthy, a row every {0.1 * every:g} s",
            partial(lambda every: taken(whole_run(35, 1200.0), slice(None, None, every)), every),
            exam=every != 10,
            verdict="none",
        )
        for every in (10, 2, 20)
    ),
    planted(
        "a stall",
        lambda: planted_in(
            whole_run(10, 500.0),
            shaft_rpm=lambda c: np.where(
                c.time_s > 350.0, 0.3 * np.sin(c.time_s * 9.0), c.shaft_rpm
            ),
        ),
        exam=True,
        onset_s={"shaft.stall": approx(350.0, abs=0.5)},
        lacks="shaft.slow",
    ),
    planted(
        "missing pulses show as dips",
        lambda: planted_in(
            whole_run(11),
            wheel_speed_mps=lambda c: (
                np.where(np.random.default_rng(0).random(len(c.time_s)) < 0.03, 0.5, 1.0)
                * c.wheel_speed_mps
            ),
        ),
        exam=True,
        names=["speed.missed_pulses"],
        sizes={"speed.missed_pulses": approx(1.5, rel=0.15)},
    ),
    planted(
        "pulses missing for a while follow no column that runs along",
        pulses_missing_for_a_while,
        exam=True,
        names=["speed.missed_pulses"],
    ),
    planted(
        "a wheel shorter on one side of a slope misses no pulses",
        partial(rolling, lambda roll: np.where(roll < -2.5, 0.85, 1.0), 1),
        exam=True,
        lacks="speed.missed_pulses",
        over="roll_deg",
    ),
    # Only the noise's own extremes pass for dips there: few of the rows, and all of them where
    # the machine leans.
    planted(
        "dips that begin on a slope alone are no missing pulses",
        partial(rolling, lambda roll: 1.0 - 0.07 * np.maximum(0.0, -roll - 2.5), 3, 0.03),
        exam=True,
        lacks="speed.missed_pulses",
    ),
    planted(
        "bridging by its share of time",
        partial(whole_run, 12, 900.0, wrong({"flow.bridging": 15.0})),
        exam=True,
        sizes={"flow.bridging": approx(15.0, abs=6.0)},
    ),
    planted("rows missing", rows_missing, exam=True, names=["shaft.load_droop"], says="missing"),
    planted(
        "a gate that hardly moves has no backlash",
        partial(small_moves, 600.0, 24.4, 25.6, 5.0, 0.0),
        exam=True,
        lacks="gate.backlash",
    ),
    planted(
        "a gate stuck while its moves are small",
        partial(small_moves, 400.0, 24.0, 26.0, 3.0, 250.0),
        exam=True,
        onset_s={"gate.stuck": approx(250.0, abs=4.0)},
    ),
    # A wheel off by a constant share, in a log whose first fit takes it for drift.
    planted(
        "a steady error is parted from drift",
        lambda: planted_in(
            whole_run(31, machine=wrong({"speed.wheel_radius": -1.6})),
            speed_mps=lambda c: (
                c.speed_mps + 0.03 * np.random.default_rng(8).standard_normal(len(c.time_s))
            ),
        ),
        exam=True,
        names=["speed.wheel_radius"],
        covers={"speed.wheel_radius": -1.6},
    ),
    # The shaft stops and starts in stretches whose speeds are empty: a line over them would
    # meter another mass.
    planted(
        "a command stands in where a reading is empty for long",
        lambda: planted_in(
            whole_run(41),
            shaft_rpm=lambda c: np.where(
                (c.time_s % 120.0 > 100.0) | (c.time_s % 120.0 < 40.0), np.nan, c.shaft_rpm
            ),
        ),
        exam=True,
        verdict="none",
    ),
]


@pytest.mark.parametrize(("log", "machine", "said"), CASES)
def test_what_is_planted_is_said(
    log: Callable[[], Columns], machine: Machine, said: Mapping[str, Any]
) -> None:
    """Of effects one in each group of channels at most: groups are judged apart, and must not
    disturb each other."""
    found_as_planted(log, machine, said)


@cache
def of_nothing(seed: int) -> Diagnosis:
    return diagnose_run(whole_run(seed), Machine())


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.exam)])
def test_nothing_wrong_is_called_nothing(seed: int) -> None:
    found = of_nothing(seed)
    check(
        found,
        verdict="none",
        unexplained=[],
        channels=["shaft", "gate", "flow", "scale", "speed", "heads"],
    )
    for channel in found.channels:
        if channel.channel in ("shaft", "gate"):
            assert channel.rmse == approx(channel.noise_floor, rel=0.1)


def test_what_is_not_named_has_a_smallest_size_or_none_at_all() -> None:
    sizes = {n.id: n.smallest_detectable.value for n in of_nothing(1).not_shown}
    assert sizes["flow.pulsation"] is None and sizes["lag.offset"] is None
    assert 0.0 < sizes["shaft.gain"] < 1.0
    assert set(sizes) == {
        one for one, entry in CATALOGUE.items() if Machine().has_stage(entry.stage)
    }, "no effort"


@pytest.mark.exam
def test_a_constant_flow_error_is_ambiguous_and_the_next_run_would_tell() -> None:
    found = diagnose_run(whole_run(8, machine=wrong({"flow.gain": 6.0})), Machine())
    assert found.verdict == "ambiguous"
    assert {c.id for c in found.causes} | {r.id for c in found.causes for r in c.rivals} >= {
        "flow.gain",
        "scale.gain",
    }
    assert found.next_run is not None and found.next_run.plan
    run = next(one for one in list_manoeuvres(Machine()) if one.id == found.next_run.id)
    assert (found.next_run.plan, found.next_run.minutes) == (
        run.plan,
        run.minutes,
    ) and found.next_run.steps
    assert all(cause.scope is None for cause in found.causes)
    assert (
        sum(r.probability for r in found.causes[0].rivals) + found.causes[0].probability
        <= 1.0 + 1e-9
    )


@pytest.mark.exam
def test_what_no_effect_explains_is_said_with_its_variable() -> None:
    found = diagnose_run(
        planted_in(
            whole_run(9), wheel_speed_mps=lambda c: c.wheel_speed_mps * (1.0 + 0.02 * c.roll_deg)
        ),
        Machine(),
    )
    check(found, verdict="unexplained")
    assert (found.unexplained[0].channel, found.unexplained[0].variable) == ("speed", "roll_deg")
    assert max(found.tables[0].values) == approx(2.0, abs=0.4)
    assert [term.acts_on.value for term in extend(Machine(), found).terms] == ["wheel_percent"]


@pytest.mark.exam
def test_extending_takes_the_effect_into_the_machine_and_the_second_look_finds_nothing() -> None:
    columns = whole_run(15, 500.0, wrong({"shaft.load_droop": 5.0}))
    first = diagnose_run(columns, Machine(), path="run.csv")
    extended = extend(Machine(), first, date="2026-01-01", sha256="ab")
    assert list_effect_sizes(extended)["shaft.load_droop"] == approx(5.0, rel=0.1)
    assert (
        extended.adopted[0].data == "run.csv" and extended.adopted[0].valid["opening_mm"][0] >= 14.0
    )
    assert diagnose_run(columns, extended).verdict == "none"
    gain = next(g for g in first.gain if g.channel == "shaft")
    assert gain.after < gain.before and gain.low <= gain.after <= gain.high
    others = {
        g.metric.split(", ")[-1].split()[0]: g
        for g in first.gain
        if g.channel == "shaft" and g is not gain
    }
    assert others.keys() == {"nameless", "placebo"}
    assert gain.after < others["nameless"].after * 1.02 and gain.after < others["placebo"].after


@pytest.mark.exam
def test_the_same_log_gives_the_same_diagnosis() -> None:
    columns = whole_run(16, 60.0, wrong({"flow.slope": 1.0}))
    assert diagnose_run(columns, Machine()).to_json() == diagnose_run(columns, Machine()).to_json()


def test_progress_is_told_and_cancel_obeyed_in_the_middle_of_the_work_of_one_stage() -> None:
    """Not only between groups of channels: every run of the model asks."""
    whole, shares, asked = whole_run(17, 120.0), list[float](), list[int]()
    diagnose_run(whole, Machine(), progress=lambda share, word: shares.append(share))
    assert shares == sorted(shares) and shares[-1] <= 1.0
    with pytest.raises(Cancelled):
        diagnose_run(whole, Machine(), cancelled=lambda: True)
    columns = {name: whole[name] for name in ("time_s", "speed_mps", "wheel_speed_mps")}
    diagnose_run(columns, Machine(), cancelled=lambda: bool(asked.append(0)))
    assert len(asked) > 20
    left = iter(range(len(asked) // 2))
    with pytest.raises(Cancelled):
        diagnose_run(columns, Machine(), cancelled=lambda: next(left, None) is None)


def test_the_gate_s_speed_may_be_off_by_its_share_of_the_nominal_one() -> None:
    machine = Machine()
    sizes = {one.key: one.sd for one in list_nuisances("gate", machine)}
    assert sizes["gate.slew_mm_s"] == approx(
        machine.gate.slew_mm_s * 0.01 * machine.tolerance.gate_slew_percent
    )


def test_manoeuvres_separate_what_they_are_for() -> None:
    plans = {m.id: m for m in list_manoeuvres(Machine())}
    gain = EffectInstance("flow.gain", 5.0)
    assert find_separation(plans["openings"], Machine(), gain, "flow.zero_offset") > 3.0
    assert find_separation(plans["standing"], Machine(), gain, "flow.zero_offset") < 1.0
    assert find_separation(plans["refill"], Machine(), gain, "scale.gain") > 3.0


@pytest.mark.exam
def test_one_stretch_alone_is_no_evidence() -> None:
    """A GNSS receiver that holds its reading through one restart of the tractor is late then,
    and not all along."""
    columns = whole_run(20, 400.0)
    time = columns["time_s"]
    stop = np.clip(np.abs(time - 200.0) / 3.0 - 1.0, 0.3, 1.0)
    for name in ("wheel_speed_mps", "speed_mps"):
        columns[name] = columns[name] * stop
    late = columns["speed_mps"] / stop * np.interp(time - 0.6, time, stop)
    columns["speed_mps"] = np.where((time > 203.0) & (time < 207.0), late, columns["speed_mps"])
    late_s = [
        (one.onset_s, one.until_s)
        for one in diagnose_run(columns, Machine()).causes
        if one.id == "speed.gnss_latency"
    ]
    assert all(
        begin is not None and end is not None and 150.0 < begin < 205.0 < end < 260.0
        for begin, end in late_s
    )


@pytest.mark.exam
def test_a_long_log_is_looked_at_in_windows_and_judged_on_every_row(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(grid, "MAX_ROWS", 5_000)
    monkeypatch.setattr(grid, "WINDOW_ROWS", 3_000)
    found = diagnose_run(whole_run(23, 900.0, wrong({"shaft.load_droop": 5.0})), Machine())
    check(
        found,
        names=["shaft.load_droop"],
        sizes={"shaft.load_droop": approx(5.0, rel=0.15)},
        says="stage shaft: what was named holds on every row",
    )
    assert "33 % of 9000 rows" in " ".join(found.findings)


@pytest.mark.exam
def test_short_bridges_show_by_the_mass_that_stayed() -> None:
    """Five spells of 4 s in which 0.12 kg/s stayed behind."""
    columns = planted_in(
        whole_run(22, 700.0),
        hopper_kg=lambda c: (
            c.hopper_kg
            + sum(
                np.clip(c.time_s - begin, 0.0, 4.0) * 0.12
                for begin in (130.0, 260.0, 385.0, 510.0, 640.0)
            )
        ),
    )
    share = 100.0 * 2.4 / float(columns["hopper_kg"][0] - columns["hopper_kg"][-1] + 2.4)
    check(
        diagnose_run(columns, Machine()), names=["flow.bridging"], covers={"flow.bridging": share}
    )


@pytest.mark.exam
def test_the_interval_of_a_dead_band_is_what_the_commands_leave_open() -> None:
    columns = whole_run(33, 400.0, wrong({"shaft.dead_band": 17.0}), shaft=(10.0, 60.0))
    found = diagnose_run(columns, Machine())
    check(found, covers={"shaft.dead_band": 17.0})
    size = next(c.size for c in found.causes if c.id == "shaft.dead_band")
    given = np.unique(np.round(columns["shaft_rpm_cmd"], 3))
    assert size.high - size.low < 3.0 * np.diff(given[given > 10.0]).max() + 0.5


@pytest.mark.exam
def test_an_encoder_in_whole_steps_is_read_off_and_hides_nothing_of_the_flow() -> None:
    found = diagnose_run(
        planted_in(
            whole_run(34, 900.0, wrong({"flow.gain": 6.0})),
            shaft_rpm=lambda c: np.round(np.round(c.shaft_rpm / 2.6) * 2.6, 3),
        ),
        Machine(),
    )
    check(found, lacks="shaft.gain", sizes={"shaft.coarse_encoder": approx(2.6, abs=0.002)})
    flow = next(c for c in found.causes if c.id.startswith(("flow.", "scale.")))
    assert "flow.gain" in {flow.id, *(r.id for r in flow.rivals)} and abs(flow.size.value) > 3.0


# --- Machines of other scale than the nominal one
# --------------------------------------------------------------------

LASTS_S = {"planter": 600.0, "spreader": 900.0}  # on one hopper


def of(name: str) -> Machine:
    return load_config(name, MACHINE_KIND).model


@pytest.mark.parametrize("name", ["drive_alone", "planter", "spreader"])
@pytest.mark.exam
def test_nothing_wrong_with_a_machine_of_another_scale_is_called_nothing(name: str) -> None:
    machine, alone = of(name), name == "drive_alone"
    found = diagnose_run(
        drive_run(machine, 1) if alone else metering_run(machine, 1, LASTS_S[name]), machine
    )
    check(
        found, verdict="none", channels=["shaft"] if alone else ["shaft", "gate", "flow", "scale"]
    )
    assert all(
        c.rmse < 1.2 * c.noise_floor for c in found.channels if c.channel in ("shaft", "gate")
    )


def drives(effect: str, size: float, exam: bool = True) -> Any:
    machine = of("drive_alone")
    return planted(
        f"drive_alone {effect}={size:g}",
        partial(drive_run, wrong({effect: size}, machine)),
        machine,
        exam=exam,
        verdict="named",
        names=[effect],
        sizes={effect: approx(size, rel=0.1)},
    )


def meters(
    name: str,
    effect: str,
    size: float,
    stands_s: float = 12.0,
    of_s: float = 120.0,
    exam: bool = True,
) -> Any:
    machine, seconds = of(name), LASTS_S[name] * (2.0 if effect == "flow.leak" else 1.0)
    return planted(
        f"{name} {effect}={size:g}",
        partial(metering_run, wrong({effect: size}, machine), 3, seconds, stands_s, of_s),
        machine,
        exam=exam,
        names=[effect],
        sizes={effect: approx(size, rel=0.25)},
        covers={effect: size},
    )


def encoder_steps_in_noise() -> Columns:
    """A step of 25 r/min with noise on top: the readings lie anywhere, and only the saw-tooth
    tells."""
    return planted_in(
        drive_run(wrong({"shaft.coarse_encoder": 25.0}, of("drive_alone"))),
        shaft_rpm=lambda c: (
            c.shaft_rpm
            + np.where(
                c.shaft_rpm > 0.0,
                2.0 * np.random.default_rng(7).standard_normal(len(c.time_s)),
                0.0,
            )
        ),
    )


@pytest.mark.parametrize(
    ("log", "machine", "said"),
    [
        drives("shaft.gain", -8.0, exam=False),
        drives("shaft.dead_band", 60.0),
        drives("shaft.dead_band", 150.0),
        drives("shaft.coarse_encoder", 16.7),
        drives("shaft.slow", 0.15),
        planted(
            "drive_alone steps below the noise are sought over this machine's range",
            encoder_steps_in_noise,
            of("drive_alone"),
            exam=True,
            names=["shaft.coarse_encoder"],
            sizes={"shaft.coarse_encoder": approx(25.0, rel=0.02)},
        ),
        meters("spreader", "gate.offset", 5.0, exam=False),
        meters("planter", "shaft.load_droop", 6.0, exam=False),
        meters("spreader", "gate.slow", 12.0),
        meters("spreader", "shaft.dead_band", 450.0),
        meters("spreader", "flow.leak", 20.0, 400.0, 600.0),
        meters("spreader", "flow.fill_falloff", 8.0),
        meters("planter", "gate.backlash", 0.4),
        meters("planter", "flow.leak", 10.0, 100.0, 200.0),
    ],
)
@pytest.mark.exam
def test_effects_of_natural_size_are_named(
    log: Callable[[], Columns], machine: Machine, said: Mapping[str, Any]
) -> None:
    found_as_planted(log, machine, said)


@pytest.mark.parametrize(
    ("name", "knock_kg", "refilled"),
    [
        ("spreader", 20.0, False),
        ("spreader", 200.0, True),
        ("planter", 1.5, False),
        ("planter", 20.0, True),
    ],
)
def test_a_refill_is_a_share_of_the_hopper(name: str, knock_kg: float, refilled: bool) -> None:
    machine = of(name)
    columns = planted_in(
        metering_run(machine, 1, 200.0, 200.0, 200.0),
        hopper_kg=lambda c: c.hopper_kg - np.where(c.time_s < 100.0, knock_kg, 0.0),
    )
    hopper = make_run_data(clean_run_log(columns), machine).hopper
    assert hopper is not None and bool(hopper.jumps) == refilled


def test_a_manoeuvre_of_another_machine_is_within_its_ranges_and_separates() -> None:
    spreader = of("spreader")
    plans = {one.id: one for one in list_manoeuvres(spreader)}
    assert plans["stairs"].plan.startswith(
        "Shaft staircase: 200, 400, 600, 800 r/min for a minute each"
    )
    assert plans["stairs"].steps[:2] == ("200 r/min for 60 s", "400 r/min for 60 s")
    for one in plans.values():
        columns = one.predict(spreader)
        assert columns["hopper_kg"].min() > 0.5 * spreader.flow.full_kg
        assert columns["opening_mm"].max() <= spreader.limits.opening_high_mm
    assert (
        find_separation(
            plans["openings"], spreader, EffectInstance("flow.gain", 5.0), "flow.zero_offset"
        )
        > 3.0
    )

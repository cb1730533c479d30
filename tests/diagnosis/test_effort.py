"""How hard the drives work: the reference of a sound run, what is named from it, and what is
not."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from topdress.console.reports.diagnosis_wording import format_verdict_line
from topdress.control.diagnosis import diagnose_run, extend
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.runs.effort_reference import fit_effort
from topdress.control.machine.flow import is_bridged
from topdress.control.machine.machine import Machine
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND
from topdress.drivers.files.read_log import read_log

from tests.diagnosis.known_causes import EXPECTED, Expected
from tests.diagnosis.logs import whole_run

# not to be handed on from here
RECORDED = Path(__file__).parents[2].parent / "shared" / "data" / "known_causes"
SCREW = Machine.model_validate(
    {
        "id": "screw",
        "stages": ["effort"],
        "effort_unit": "A",
        "gate": {"slew_mm_s": 30.0, "full_mm": 150.0},
        "limits": {"opening_low_mm": 0.0, "opening_high_mm": 150.0},
    }
)
METERING = Machine.model_validate({"id": "metering", "stages": ["effort"]})
Columns = dict[str, Any]


@cache
def recorded(name: str, load_kgf: int) -> Columns:
    """The moves of one recording at one load, one after the other: set point, place and
    current, 25 Hz."""
    table = np.genfromtxt(RECORDED / f"actuator_{name}.csv.gz", delimiter=",", names=True)
    rows = table[table["load"] == load_kgf]
    rows = rows[np.lexsort((rows["time"], rows["group"], rows["run"]))]
    return {
        "time_s": 0.04 * np.arange(len(rows)),
        "opening_mm_cmd": rows["set_point"],
        "opening_mm": rows["set_point"] - rows["position_error"],
        "gate_effort": rows["current"],
    }


@cache
def sound_screw(load_kgf: int) -> Machine:
    return fit_effort(recorded("normal", load_kgf), SCREW, "normal")[0]


@pytest.mark.exam
@pytest.mark.skipif(
    not RECORDED.is_dir(), reason="the recordings are not in ../shared/data/known_causes"
)
@pytest.mark.parametrize("one", EXPECTED, ids=lambda one: f"{one.recording} {one.load_kgf}")
def test_an_actuator_whose_cause_is_known(one: Expected) -> None:
    found = diagnose_run(recorded(one.recording, one.load_kgf), sound_screw(one.load_kgf))
    assert [cause.id for cause in found.causes] == (
        ["effort.gate_friction"] if one.cause == "friction" else []
    )
    for cause in found.causes:
        assert cause.size.low is not None and cause.size.high is not None
        assert cause.size.low < one.percent < cause.size.high and cause.probability > 0.95
    assert any("does not show at this load" in note for note in found.findings), (
        "what this load hides"
    )


def hidden_log(seed: int, **more: float) -> Columns:
    columns: Columns = importlib.import_module("tests.diagnosis.hidden.effort").log(seed, **more)
    return columns


@cache
def sound() -> Machine:
    machine, (fit,) = fit_effort(hidden_log(1), METERING, "sound.csv")
    assert [place for place, _, _ in fit.numbers] == [
        "effort.coulomb",
        "effort.viscous",
        "effort.load",
    ]
    return machine


def test_a_file_that_lists_its_stages_reads_the_effort_that_is_written_into_it() -> None:
    for stages, then in ((("shaft",), ("shaft", "effort")), ((), ())):
        listed = METERING.model_copy(update={"stages": stages})
        assert fit_effort(hidden_log(1), listed, "sound.csv")[0].stages == then


def named(found: Diagnosis) -> dict[str, tuple[float, float]]:
    return {
        cause.id: (float(cause.size.low or 0.0), float(cause.size.high or 0.0))
        for cause in found.causes
        if cause.probability > 0.5
    }


@pytest.mark.parametrize(
    ("planted", "expected", "percent"),
    [
        ({}, "", 0.0),
        ({"dry": 1.6}, "effort.friction", 60.0),
        ({"material": 0.0}, "effort.load", -100.0),
        ({"material": 1.7}, "effort.load", 70.0),
        ({"supply_v": 12.0}, "", 0.0),
    ],
    ids=str,
)
def test_what_is_planted_in_the_motors_circuit_is_named(
    planted: dict[str, float], expected: str, percent: float
) -> None:
    found = diagnose_run(hidden_log(2, **planted), sound())
    assert list(named(found)) == ([expected] if expected else []), found.causes
    for low, high in named(found).values():
        assert low - 2.0 < percent < high + 2.0


@pytest.mark.exam
def test_a_load_that_goes_in_the_middle_is_dated_and_adopted_it_is_known() -> None:
    columns = hidden_log(3, material=0.0, from_s=300.0)
    found = diagnose_run(columns, sound())
    (cause,) = [cause for cause in found.causes if cause.probability > 0.5]
    assert cause.id == "effort.load" and cause.onset_s == pytest.approx(300.0, abs=5.0)
    steady = diagnose_run(hidden_log(4, material=0.4), sound())
    assert named(diagnose_run(hidden_log(5, material=0.4), extend(sound(), steady))) == {}


@cache
def simulated(topdress: Callable[..., Result], folder: Path, effect: str) -> Columns:
    """A log in closed loop, the scale correcting the flow, in which something begins."""
    run = folder / f"{effect[:8]}.csv"
    assert (
        topdress(
            "simulate", "--seconds", "400", "--seed", "3", "--effect", effect, "--out", run
        ).exit_code
        == 0
    )
    return dict(read_log(run).columns)


@pytest.mark.parametrize(
    "scale",
    [pytest.param(True, id="scale", marks=pytest.mark.exam), pytest.param(False, id="no scale")],
)
@pytest.mark.parametrize(
    ("effect", "size"), [("flow.blocked_outlet=16.7@200", 16.7), ("flow.bridging=10", 10.0)]
)
@pytest.mark.exam
def test_what_a_loop_hides_is_named_in_closed_loop(
    effect: str,
    size: float,
    scale: bool,
    topdress: Callable[..., Result],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    columns = simulated(topdress, tmp_path_factory.getbasetemp(), effect)
    if not scale:
        columns = {name: values for name, values in columns.items() if name != "hopper_kg"}
    found = diagnose_run(columns, load_config("huanghai", MACHINE_KIND).model)
    (cause,) = found.causes
    names = {cause.id: cause.probability} | {one.id: one.probability for one in cause.rivals}
    # its slots come at fixed irregular times: their share while the shaft turns
    if "bridging" in effect:
        size = 100.0 * float(
            np.mean(
                [is_bridged(at_s, size) for at_s in columns["time_s"][columns["shaft_rpm"] > 5.0]]
            )
        )
    if scale or "bridging" in effect:
        assert names[effect.split("=")[0]] > 0.95 and cause.size.value == pytest.approx(
            size, rel=0.05, abs=0.5
        )
    # wet product loads the drive as well: without a scale nobody tells them apart
    else:
        assert (
            set(names) == {"flow.blocked_outlet", "effort.load"}
            and names["flow.blocked_outlet"] > 0.3
        )
        plain = format_verdict_line(found)
        assert plain.startswith("Either ") and "nothing in this data tells which" in plain
        assert "One or more outlets close" in plain and "Catch test by outlet" in plain


def test_a_drive_that_is_read_with_noise_and_held_steady_leaves_no_effort_that_follows_it() -> None:
    """The closer a loop holds its speed, the more of what its reading varies by is the
    reading's own noise."""
    rng, count = np.random.default_rng(1), 9000
    columns: Columns = {
        "time_s": 0.1 * np.arange(count),
        "shaft_rpm_cmd": np.full(count, 60.0),
        "shaft_rpm": 60.0 + 0.8 * rng.standard_normal(count),
        "opening_mm": np.full(count, 25.0),
        "opening_mm_cmd": np.full(count, 25.0),
        "supply_v": np.full(count, 13.5),
    }
    columns["shaft_effort"] = 8.0 + 0.6 * 60.0 + 0.06 * 137.5 + rng.standard_normal(count)
    machine = load_config("huanghai", MACHINE_KIND).model.model_copy(update={"stages": ("effort",)})
    assert diagnose_run(columns, machine).verdict == "none"


def test_calibrate_effort_finds_what_the_drive_is_made_of(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    columns, run, new = hidden_log(1), tmp_path / "run.csv", tmp_path / "new.yaml"
    np.savetxt(
        run,
        np.column_stack(list(columns.values())),
        delimiter=",",
        header=",".join(columns),
        comments="",
        fmt="%.6g",
    )
    result = topdress("calibrate", "effort", run, "--out", new)
    assert result.exit_code == 0, result.output
    made = load_config(str(new), MACHINE_KIND).model
    # 100 % / 13.5 V of the generator's circuit: its e.m.f. and oil for each r/min, its dry
    # torque, its material's.
    assert made.effort.viscous == pytest.approx(0.604, rel=0.03)
    assert made.effort.coulomb == pytest.approx(
        8.19, rel=0.1
    ) and made.effort.load == pytest.approx(0.0614, rel=0.05)
    assert made.noise.effort == pytest.approx(1.0, rel=0.1), (
        "of a reading, as planted; not of a half second's mean"
    )
    assert {one.id for one in made.adopted} >= {"effort.coulomb", "effort.viscous", "effort.load"}
    silent = tmp_path / "silent.csv"
    silent.write_text(
        run.read_text(encoding="utf-8").replace("shaft_effort", "x_effort"), encoding="utf-8"
    )
    refused = topdress("calibrate", "effort", silent, "--out", tmp_path / "no.yaml")
    assert refused.exit_code != 0 and "no drive tells how hard it works" in refused.output
    assert not (tmp_path / "no.yaml").exists()


@pytest.mark.exam
def test_a_simulated_run_at_one_speed_tells_effort_and_says_what_it_does_not_tell_apart(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    run = tmp_path / "run.csv"
    assert topdress("simulate", "--seconds", "300", "--out", run).exit_code == 0
    log = read_log(run)
    turning = log.numbers("shaft_rpm") > 60.0
    own = 8.0 + 0.6 * log.numbers("shaft_rpm") + 0.06 * 5.5 * log.numbers("opening_mm")
    wanted = own * 13.5 / log.numbers("supply_v")
    assert np.nanmedian((log.numbers("shaft_effort") - wanted)[turning]) == pytest.approx(
        0.0, abs=0.2
    )
    result = topdress("calibrate", "effort", run, "--out", tmp_path / "new.yaml")
    assert (
        result.exit_code == 0
        and "one speed: what goes with speed does not part from dry friction" in result.output
    )


@cache
def run_with_effort() -> Columns:
    """Ten minutes of a healthy machine, with the effort of its shaft's drive."""
    log, rng = dict(whole_run(3)), np.random.default_rng(4)
    load = 8.0 + 0.6 * log["shaft_rpm"] + 0.06 * 5.5 * log["opening_mm"] * (log["shaft_rpm"] > 5.0)
    log["shaft_effort"] = np.where(
        log["shaft_rpm"] > 2.0,
        load * 13.5 / log["supply_v"] + rng.standard_normal(len(load)),
        0.0,
    )
    return log


def with_effort() -> Machine:
    return load_config("huanghai", MACHINE_KIND).model


@pytest.mark.exam
def test_a_current_sensor_that_reads_by_the_supply_is_no_bridge() -> None:
    """It reads 40 % more for each missing volt, so less at a high supply; the scale says that
    the flow is sound."""
    log = dict(run_with_effort())
    log["shaft_effort"] = log["shaft_effort"] * (1.0 + 0.4 * (13.5 - log["supply_v"]))
    assert "flow.bridging" not in {cause.id for cause in diagnose_run(log, with_effort()).causes}


def test_an_effort_without_the_columns_that_it_depends_on_is_left_out() -> None:
    kept = {"time_s", "shaft_rpm_cmd", "shaft_rpm", "shaft_effort"}
    log = {name: values for name, values in run_with_effort().items() if name in kept}
    found = diagnose_run(log, with_effort())
    assert not found.causes
    assert any(
        text.startswith("effort is left out: it depends on opening_mm") for text in found.findings
    )

"""The entry of a notebook: `from topdress.control.diagnosis import diagnose_run, diagnose_tables,
extend`."""

from __future__ import annotations

import ast
import doctest
import subprocess
import sys
from importlib import import_module
from math import exp
from pathlib import Path

import numpy as np
import pytest
import topdress.control.diagnosis as entry
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.dataframe_input import read_columns
from topdress.control.diagnosis.judgement.prior import SIZE_ERROR
from topdress.control.diagnosis.runs import report
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.diagnosis.runs.model import list_nuisances
from topdress.control.diagnosis.runs.residual_analysis import ResidualStructure
from topdress.control.diagnosis.runs.search import Search
from topdress.control.diagnosis.runs.selection import Alternatives, RivalEffect
from topdress.control.diagnosis.runs.smooth import MIN_RANGE
from topdress.control.machine.machine import CATALOGUE, Machine
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

import topdress
from tests.diagnosis.logs import HUANGHAI, Columns, stairs_work, taken


@pytest.mark.parametrize(
    "module", ["topdress.control.diagnosis.runs.diagnose", "topdress.control.diagnosis.extend"]
)
def test_the_examples_in_the_docstrings_do_what_they_say(module: str) -> None:
    tried = doctest.testmod(import_module(module))
    assert tried.attempted >= 4 and tried.failed == 0


def test_the_entry_has_what_a_notebook_needs() -> None:
    for name in entry.__all__:
        assert callable(getattr(entry, name)), name
    from topdress.control.diagnosis.runs.diagnose import diagnose_run

    assert entry.diagnose_run is diagnose_run
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        _ = entry.nothing_of_the_kind


def test_a_page_that_only_shows_a_diagnosis_starts_without_the_search() -> None:
    asked = (
        "import sys, topdress.control.diagnosis.result; "
        "print(sorted({'scipy', 'numba'} & set(sys.modules)))"
    )
    told = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


def test_the_package_gives_what_a_notebook_needs() -> None:
    for name in topdress.__all__:
        assert callable(getattr(topdress, name)), name
    assert topdress.diagnose_run is entry.diagnose_run
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        _ = topdress.nothing_of_the_kind


def test_a_log_that_was_read_is_diagnosed_as_the_package_says(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 60.0, 0.1)
    table = np.column_stack([time_s, 1.3 + 0.0 * time_s, 1.3 + 0.0 * time_s])
    np.savetxt(
        tmp_path / "run.csv",
        table,
        delimiter=",",
        header="time_s,speed_mps,wheel_speed_mps",
        comments="",
    )
    log = topdress.read_log(tmp_path / "run.csv")
    assert read_columns(log).keys() >= {"time_s", "speed_mps", "wheel_speed_mps"}
    assert topdress.diagnose_run(log, Machine()).data.rows == 600


def test_a_machine_file_is_saved_and_read_again(tmp_path: Path) -> None:
    topdress.save(tmp_path / "fan.yaml", Machine(id="fan"), "of a test")
    assert load_config(tmp_path / "fan.yaml", MACHINE_KIND).model.id == "fan"


def test_the_package_says_that_it_has_types() -> None:
    assert (Path(topdress.__file__).parent / "py.typed").exists()


@pytest.mark.parametrize("worth", [-1e6, -0.4, 0.0, 3.0, 1e6])
def test_what_may_stand_in_a_part_s_place_has_all_of_the_probability(worth: float) -> None:
    place = Alternatives(
        worth, (RivalEffect(EffectInstance("shaft.slow", 0.1), 1.0),), unknown=-2.0
    )
    one = place.calc_probabilities()
    assert one.part + sum(one.rivals) + one.unknown == pytest.approx(
        1.0 / (1.0 + exp(-worth) / (1.0 + exp(-1.0) + exp(-2.0))) if worth > -700.0 else 0.0
    )
    assert one.rivals[0] == pytest.approx(one.part * exp(-1.0)) and one.unknown == pytest.approx(
        one.part * exp(-2.0)
    )
    assert place.calc_probabilities(0.6)[:2] == (
        pytest.approx(0.4 * one.part),
        (pytest.approx(0.4 * one.rivals[0]),),
    )


def too_fast() -> Columns:
    work = taken(stairs_work(), slice(4000))  # 200 s
    return {name: work[name] for name in ("time_s", "shaft_rpm_cmd")} | {
        "shaft_rpm": 1.06 * work["shaft_rpm"]
    }


@pytest.mark.exam
def test_no_model_is_held_twice_against_the_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    scans: list[tuple[object, ...]] = []
    scan = Search.scan_candidates
    monkeypatch.setattr(
        Search,
        "scan_candidates",
        lambda of, parts, noise: (
            scans.append(
                (
                    of.model.names,
                    of.model.moves,
                    parts,
                    *(one.sum() for one in of.model.drawn_in.values()),
                )
            )
            or scan(of, parts, noise)
        ),
    )
    assert (
        "shaft.gain" in [cause.id for cause in diagnose_run(too_fast(), HUANGHAI).causes]
        and len(scans) > 2
    )
    assert len(set(scans)) == len(scans)


# --- What a diagnosis knows of an effect stands in one place: its row in
# control/diagnosis/effects.py ----------------

ROOM = Path(effects.__file__).parent


def ids_in(path: Path) -> list[str]:
    """String literals of a file that are the id of an effect, with their lines."""
    return [
        f"{path.name}:{node.lineno}: {node.value}"
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and node.value in CATALOGUE
    ]


@pytest.mark.parametrize("folder", ["", "runs", "tables"])
def test_no_effect_is_named_by_its_id_outside_its_row(folder: str) -> None:
    pattern = "*.py" if not folder else f"{folder}/**/*.py"
    found = [
        line
        for path in sorted(ROOM.glob(pattern))
        if path.name != "effects.py"
        for line in ids_in(path)
    ]
    assert not found


def test_every_effect_has_one_row_and_every_row_an_effect() -> None:
    rows = [row for row in vars(effects).values() if isinstance(row, effects.EffectRow)]
    assert sorted(row.id for row in rows) == sorted(CATALOGUE)
    for name, row in vars(effects).items():
        if isinstance(row, effects.EffectRow):
            assert name == row.id.replace(".", "_").upper()


def test_what_rows_refer_to_is_there() -> None:
    machine = Machine()
    for row in effects.EFFECT_ROWS.values():
        assert set(row.siblings) <= set(CATALOGUE)
        assert {row.form_over} - {""} <= set(MIN_RANGE)
        assert not row.moves or row.moves in {n.field for n in list_nuisances(row.stage, machine)}
        for sibling in row.siblings:
            assert effects.EFFECT_ROWS[sibling].trial_sizes, (
                f"{row.id}: {sibling} has no trial sizes to take its slope on"
            )


@pytest.mark.exam
def test_a_name_in_whose_place_something_unknown_stands_for_certain_is_not_listed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It was listed with probability 0, at the bound of its size and with a larger error than
    before; it is named where nothing unknown stands (the test before)."""
    left = ResidualStructure("shaft", "loud")
    monkeypatch.setattr(
        report,
        "find_residual_structure",
        lambda one, _: [left] if one.search.model.names[0] == "shaft" else [],
    )
    monkeypatch.setattr(report, "calc_unknown_prob", lambda one, k, rest: 1.0)
    found = diagnose_run(too_fast(), HUANGHAI)
    assert (
        found.verdict == "unexplained"
        and found.causes == ()
        and {u.channel for u in found.unexplained} == {"shaft"}
    )
    assert not [gain for gain in found.gain if gain.of == "names"]


@pytest.mark.parametrize(("begin_percent", "end_percent"), [(4.0, 4.0), (2.0, 4.0)])
def test_an_interval_holds_the_sizes_that_a_fault_goes_through(begin_percent, end_percent):
    """A wheel that wears all along is none of the catalogue's courses: one size says no more
    than how far it goes."""
    rng, time_s = np.random.default_rng(1), np.arange(0.0, 600.0, 0.1)
    speed_mps = 1.3 + 0.2 * np.sin(time_s / 7.0)
    more = 1.0 + 0.01 * np.linspace(begin_percent, end_percent, len(time_s))
    found = diagnose_run(
        {
            "time_s": time_s,
            "speed_mps": speed_mps + 0.03 * rng.standard_normal(len(time_s)),
            "wheel_speed_mps": more * speed_mps + 0.02 * rng.standard_normal(len(time_s)),
        },
        Machine(),
    )
    [size] = [cause.size for cause in found.causes]
    most_percent = abs(end_percent - begin_percent)
    assert size.low < begin_percent + 0.1 and size.high > end_percent - 0.1
    assert size.high - size.low < SIZE_ERROR * (0.2 + most_percent)

"""The examination is examined: proper scores, no peeking, a folder for each entry, cases as the
README says, and the README's own entry."""

from __future__ import annotations

import ast
import importlib
import json
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
HERE = ROOT / "benchmarks" / "examination"
PATHS = [HERE, ROOT / "benchmarks" / "diagnosis", ROOT / "benchmarks", Path(__file__).parent]
IDS = ("shaft.gain", "shaft.slow", "flow.gain", "scale.gain")


@pytest.fixture(scope="module")
def exam() -> Iterator[Any]:
    """Modules of the examination by name; its program as `main`."""
    before = list(sys.path)
    sys.path[:0] = [str(path) for path in PATHS]
    try:
        modules = {
            name: importlib.import_module(name)
            for name in (
                "cases",
                "drives",
                "entries",
                "export",
                "peers",
                "plain",
                "report",
                "score",
            )
        }
        program = SimpleNamespace(**runpy.run_path(str(HERE / "__main__.py"), run_name="exam"))
        yield SimpleNamespace(**modules, main=program)
    finally:
        sys.path[:] = before


@pytest.fixture(scope="module")
def table(exam: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A case with a bench table."""
    return exam.cases.write_case(2, 17, tmp_path_factory.mktemp("exam"), "tuning")


def _say(p: dict[str, float], none: float, unknown: float) -> dict[str, Any]:
    return {"causes": p, "none": none, "unknown": unknown, "size": {}}


def _truth(*ids: str, unknown: bool = False, alike: dict[str, list[str]] | None = None) -> Any:
    return {
        "ids": list(ids),
        "unknown": unknown,
        "none": not ids and not unknown,
        "sizes": {},
        "alike": alike or {},
    }


def test_who_says_what_is_true_of_many_machines_scores_best(exam: Any) -> None:
    rng = np.random.default_rng(3)
    true = {"shaft.gain": 0.3, "flow.gain": 0.1}
    truths = [_truth(*(name for name, p in true.items() if rng.random() < p)) for _ in range(4000)]
    said = _say(true, 0.63, 0.0)

    def mean(answer: dict[str, Any], field: str) -> float:
        return float(
            np.mean([getattr(exam.score.score_answer(answer, t, IDS), field) for t in truths])
        )

    for field in ("log_score", "brier"):
        best = mean(said, field)
        for other in (
            _say({**true, "shaft.gain": 0.4}, 0.63, 0.0),
            _say({**true, "shaft.gain": 0.2}, 0.63, 0.0),
            _say(true, 0.75, 0.0),
            _say({"shaft.gain": 0.3}, 0.63, 0.0),
        ):
            assert mean(other, field) > best, field


def test_what_is_left_out_costs_as_much_as_what_is_said_with_nought(exam: Any) -> None:
    truth = _truth("shaft.gain")
    short = exam.score.score_answer(_say({"shaft.gain": 1.0}, 0.0, 0.0), truth, IDS)
    long = exam.score.score_answer(
        _say({**dict.fromkeys(IDS, 0.0), "shaft.gain": 1.0}, 0.0, 0.0), truth, IDS
    )
    assert short == long
    assert short.log_score == pytest.approx(-6 * np.log(0.999))


def test_effects_that_leave_one_trace_are_one_label(exam: Any) -> None:
    truth = _truth("flow.gain", alike={"flow.gain": ["scale.gain"]})
    one = exam.score.score_answer(_say({"flow.gain": 0.5, "scale.gain": 0.5}, 0.0, 0.0), truth, IDS)
    assert one.log_score == pytest.approx(-5 * np.log(0.999))
    assert one.found


def test_recordings_of_one_machine_are_resampled_together(exam: Any) -> None:
    values = [0.0] * 50 + [1.0] * 50
    apart = exam.score.find_interval(values, [""] * 100)
    together = exam.score.find_interval(values, ["a"] * 50 + ["b"] * 50)
    assert apart[0] == together[0] == 0.5
    assert together[2] - together[1] > 4.0 * (apart[2] - apart[1])


def test_brier_is_reliability_less_resolution_and_uncertainty(exam: Any) -> None:
    truths = [_truth("shaft.gain")] * 3 + [_truth()] * 7
    scored = [exam.score.score_answer(_say({"shaft.gain": 0.2}, 0.6, 0.05), t, IDS) for t in truths]
    reliability, resolution, uncertainty = exam.score.split_brier(scored)
    brier = float(np.mean([one.brier for one in scored]))
    assert reliability - resolution + uncertainty == pytest.approx(brier, abs=1e-5)
    assert reliability > 0.0 < resolution


def test_an_entry_that_opens_the_truth_is_caught_and_has_no_answer(
    exam: Any, table: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def peek(data: Path, machine: Path) -> dict[str, Any]:
        truth = json.loads((table.truth / "truth.json").read_text(encoding="utf-8"))
        return _say(dict.fromkeys(truth["ids"], 1.0), float(truth["none"]), 0.0)

    monkeypatch.setitem(exam.entries.BUILT_IN, "peeks", peek)
    kept = exam.main.ask_entry("peeks", table)
    assert "only the scorer" in kept["trouble"]
    assert kept["answer"]["causes"] == {}
    # Afterwards the scorer reads it again.
    assert json.loads((table.truth / "truth.json").read_text(encoding="utf-8"))


def test_an_entry_finds_nothing_that_another_wrote_and_no_name_of_the_case(
    exam: Any, table: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[list[str], str]] = []

    def write(data: Path, machine: Path) -> dict[str, Any]:
        seen.append((sorted(p.name for p in data.parent.iterdir()), str(data)))
        (data.parent / "left.txt").write_text("said", encoding="utf-8")
        return _say({}, 1.0, 0.0)

    monkeypatch.setitem(exam.entries.BUILT_IN, "writes", write)
    for _ in range(2):
        assert exam.main.ask_entry("writes", table)["trouble"] is None
    assert [names for names, _ in seen] == [["bench.csv", "kind.txt", "machine.yaml"]] * 2
    assert seen[0][1] != seen[1][1] and table.folder.name not in seen[0][1]
    assert not (table.folder / "left.txt").exists()


def test_cases_are_what_the_readme_says_and_the_same_twice(
    exam: Any, table: Any, tmp_path: Path
) -> None:
    again = exam.cases.write_case(2, 17, tmp_path, "tuning")
    for name in ("bench.csv", "kind.txt", "machine.yaml"):
        assert (again.folder / name).read_bytes() == (table.folder / name).read_bytes()
    drive = exam.cases.write_case(4, 17, tmp_path, "tuning")
    head = (drive.folder / "log.csv").read_text(encoding="utf-8").splitlines()[0]
    assert head == "time_s,shaft_rpm_cmd,shaft_rpm,supply_v"
    truth = json.loads((drive.truth / "truth.json").read_text(encoding="utf-8"))
    assert truth["none"] + truth["unknown"] + bool(truth["ids"]) == 1
    assert not list(drive.folder.glob("*truth*"))


def test_a_report_without_findings_says_none_and_the_prior_of_what_is_too_small(
    exam: Any, tmp_path: Path
) -> None:
    drive = exam.cases.write_case(4, 23, tmp_path, "tuning")
    kept = exam.main.ask_entry("topdress", drive)
    assert kept["trouble"] is None
    answer = kept["answer"]
    assert 0.0 < answer["none"] <= 1.0 and 0.0 < answer["unknown"] < 1.0
    said = [p for p in answer["causes"].values() if p < 0.5]
    # The prior of the shaft's group is 0.3 over all its effects.
    assert 0.0 < sum(said) < 0.3
    assert kept["gain"] > 0.0


def test_a_report_on_a_table_names_effects_of_tables_only(exam: Any, table: Any) -> None:
    kept = exam.main.ask_entry("topdress", table)
    assert kept["trouble"] is None
    kind = (table.folder / "kind.txt").read_text(encoding="utf-8")
    assert all(
        name.split(".")[0] in (kind, "flow", "scale", "speed", "shaft", "canopy", "place")
        for name in kept["answer"]["causes"]
    )
    assert sum(kept["answer"]["causes"].values()) < 2.0


def test_the_page_has_the_table_by_score_and_a_picture(exam: Any, tmp_path: Path) -> None:
    truths = [_truth("shaft.gain"), _truth(), _truth("flow.gain"), _truth()]

    def ask(good: float) -> list[Any]:
        return [
            exam.score.score_answer(
                _say(dict.fromkeys(t["ids"], good), good * t["none"], 0.01), t, IDS, 0.5, 1.0
            )
            for t in truths
        ]

    by_entry = {"constant": ask(0.3), "topdress": ask(0.9)}
    out = tmp_path / "page.md"
    page = exam.report.write_page(
        by_entry, ["run", "run", "drive", "table"], {"topdress": 1, "constant": 0}, out
    )
    rows = [line.split(" | ")[0] for line in page.splitlines() if line.startswith("| ")]
    assert rows[1:3] == ["| topdress", "| constant"]
    assert "peeked): topdress 1" in page and "![" in page
    picture = ElementTree.fromstring((tmp_path / "page.svg").read_text(encoding="utf-8"))
    assert picture.tag.endswith("svg") and len(list(picture)) > 2


def _drive_case(exam: Any, off: dict[str, float], folder: Path) -> tuple[Path, Path]:
    """Files of one drive that is off by sizes by id."""
    rng = np.random.default_rng(11)
    drive = exam.drives.draw_drive(rng)
    speed = exam.drives.simulate(drive, off, 0) + drive.noise_rpm * rng.normal(
        size=len(drive.command_rpm)
    )
    columns = {
        "time_s": np.arange(len(speed)) * drive.row_s,
        "shaft_rpm_cmd": drive.command_rpm,
        "shaft_rpm": speed,
        "supply_v": drive.supply_v,
    }
    exam.cases.write_columns(folder / "log.csv", columns)
    (folder / "machine.yaml").write_text(exam.drives.format_machine(drive), encoding="utf-8")
    (folder / "kind.txt").write_text("run", encoding="utf-8")
    return folder / "log.csv", folder / "machine.yaml"


FAULTS = {"shaft.gain": 6.0, "shaft.slow": 0.3, "shaft.dead_zone": 12.0, "shaft.dead_time": 0.04}


@pytest.mark.parametrize("name, size", FAULTS.items())
def test_the_plain_model_names_and_sizes_a_drives_fault(
    exam: Any, tmp_path: Path, name: str, size: float
) -> None:
    case = exam.plain.read_case(*_drive_case(exam, {name: size}, tmp_path))
    said = exam.peers.find_by_least_squares(case)
    assert max(said.odds, key=lambda n: said.odds[n]) == name
    assert said.odds[name] > 3.0
    assert said.sizes[name][0] == pytest.approx(size, rel=0.3)


def test_the_plain_model_names_nothing_of_a_sound_drive(exam: Any, tmp_path: Path) -> None:
    case = exam.plain.read_case(*_drive_case(exam, {"ratio": 0.004, "tau_s": 0.01}, tmp_path))
    assert max(exam.peers.find_by_least_squares(case).odds.values()) < 0.0


def test_a_drives_trace_loses_what_its_tolerances_do(exam: Any) -> None:
    seen = exam.drives.see(exam.drives.draw_drive(np.random.default_rng(5)))
    # A ratio that is off by one standard deviation weighs at most one.
    assert np.linalg.norm(seen.whiten({"ratio": 0.005}, 0)) < 1.05
    assert np.linalg.norm(seen.whiten({"shaft.dead_zone": 20.0}, 0)) > 5.0


def test_an_export_has_csv_and_parquet_alike_and_a_card(
    exam: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import polars

    monkeypatch.setattr(exam.cases, "TURNS", ("table", "drive"))
    monkeypatch.setattr(sys, "argv", ["export.py", "--cases", "2", "--out", str(tmp_path)])
    assert exam.export.main() == 0
    for path in tmp_path.rglob("*.csv"):
        assert polars.read_parquet(path.with_suffix(".parquet")).equals(polars.read_csv(path))
    card = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "2 cases of seed 1" in card and "| drive |" in card
    assert len(polars.read_parquet(tmp_path / "truth.parquet")) == 2


def test_the_examination_knows_the_diagnosis_through_its_entry_only() -> None:
    for path in sorted(HERE.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = (
                [a.name for a in node.names]
                if isinstance(node, ast.Import)
                else [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            for name in names:
                if name.startswith("topdress.control.diagnosis"):
                    assert path.name == "entries.py", f"{path.name} imports {name}"


def test_the_readme_entry_runs_as_written(exam: Any, table: Any, tmp_path: Path) -> None:
    text = (HERE / "README.md").read_text(encoding="utf-8")
    code = text.split("```python\n")[1].split("```")[0]
    lines = [line for line in code.splitlines() if line.strip()]
    assert len(lines) <= 11
    space: dict[str, Any] = {}
    exec(code, space)
    answer = space["diagnose"](table.folder / "bench.csv", table.folder / "machine.yaml")
    truth = json.loads((table.truth / "truth.json").read_text(encoding="utf-8"))
    assert exam.score.score_answer(answer, truth, IDS).log_score > 0.0

"""`topdress diagnose`: what it refuses to adopt, and the job that its closed loop simulates."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from topdress.console.cli import app
from topdress.console.cli.diagnose import adopt_findings
from topdress.console.reports.diagnosis_wording import sort_adoptable
from topdress.control.diagnosis.result import UNKNOWN, Rival
from topdress.control.diagnosis.tables import diagnose_tables
from topdress.control.machine.machine import Machine
from topdress.drivers.files.bench_table import read_bench_table
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND
from typer.testing import CliRunner


def lag_table(path: Path, later_s: float, label: str = "", more_s: float = 0.0) -> Path:
    """Nominal whole lags, `later_s` later; with a `label`, half of the rows carry it and are
    `more_s` later still."""
    rng = np.random.default_rng(3)
    lines = ["shaft_rpm,lag_s" + (",tractor" if label else "")]
    for k in range(42):
        rpm = 10.0 + 10.0 * (k % 7)
        own = label and k % 2 == 0
        lag = (
            0.383
            + 1.8288
            - 0.0083 * rpm
            + later_s
            + (more_s if own else 0.0)
            + 0.02 * rng.standard_normal()
        )
        lines.append(f"{rpm:g},{lag:.3f}" + (f",{label if own else 'other'}" if label else ""))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_an_effect_of_one_label_is_not_adopted(tmp_path: Path) -> None:
    table = lag_table(tmp_path / "two.csv", 0.0, "blue", 0.3)
    out = tmp_path / "new.yaml"
    asked = CliRunner().invoke(
        app, ["diagnose", str(table), "--adopt", str(out), "--json", str(tmp_path / "f.json")]
    )
    assert asked.exit_code == 2 and not out.exists()
    assert "holds for two.csv blue only, not for the machine" in asked.output
    assert json.loads((tmp_path / "f.json").read_text())["causes"][0]["scope"] == "two.csv blue"


def test_with_nothing_to_adopt_the_diagnosis_is_printed_and_written(tmp_path: Path) -> None:
    table = lag_table(tmp_path / "one.csv", 0.0)
    out, page, result = tmp_path / "new.yaml", tmp_path / "p.html", tmp_path / "f.json"
    asked = CliRunner().invoke(
        app,
        ["diagnose", str(table), "--adopt", str(out), "--json", str(result), "--report", str(page)],
    )
    assert asked.exit_code == 3 and not out.exists(), asked.output
    assert "new.yaml: not written: no effect and no term was found" in asked.stderr
    assert json.loads(result.read_text())["verdict"] == "none" and page.exists()
    assert asked.stdout.strip() and json.loads(result.read_text())["extended_machine"] is None


def diagnosed(tmp_path: Path, *more: str) -> tuple[Result, dict[str, Any]]:
    """A table that cannot tell two causes apart; what the command said, and its JSON."""
    table, told = lag_table(tmp_path / "one.csv", 0.3), tmp_path / "f.json"
    asked = CliRunner().invoke(
        app,
        ["diagnose", str(table), "--adopt", str(tmp_path / "new.yaml"), "--json", str(told), *more],
    )
    return asked, json.loads(told.read_text())


def test_what_the_data_cannot_tell_apart_is_not_adopted(tmp_path: Path) -> None:
    asked, told = diagnosed(tmp_path)
    assert asked.exit_code == 3 and not (tmp_path / "new.yaml").exists(), asked.output
    own = told["causes"][0]["id"]
    rivals = [one["id"] for one in told["causes"][0]["rivals"] if one["id"] != own]
    notes = [line for line in asked.stderr.splitlines() if line.startswith("note:")]
    assert notes == [
        f"note: {own} is not adopted: this data cannot tell it from {', '.join(rivals)}; "
        f"--pick {own} "
        "adopts it all the same"
    ]
    assert (
        "new.yaml: not written: what was found is undecided, and nothing of it was picked"
        in asked.stderr
    )
    assert (
        asked.stdout.strip() and told["verdict"] == "ambiguous" and told["extended_machine"] is None
    )


def test_what_is_picked_by_its_name_is_adopted(tmp_path: Path) -> None:
    own = diagnosed(tmp_path)[1]["causes"][0]["id"]
    asked, told = diagnosed(tmp_path, "--pick", own, "--force")
    out = tmp_path / "new.yaml"
    assert asked.exit_code == 0 and told["extended_machine"] == str(out), asked.output
    assert f"note: {own} is adopted as picked, though this data cannot tell it from" in asked.stderr
    assert f"topdress history {out} --undo --out FILE takes it back" in asked.stderr
    assert [one.id for one in load_config(out, MACHINE_KIND).model.adopted] == [own]
    assert out.read_text().startswith(
        f"# {own}: picked by name (diagnose --pick), though this data cannot tell it"
    )


@pytest.mark.exam
def test_a_rival_whose_size_nobody_knows_cannot_be_picked(tmp_path: Path) -> None:
    cause = diagnosed(tmp_path)[1]["causes"][0]
    rival = next(one["id"] for one in cause["rivals"] if one["id"] != cause["id"])
    asked, told = diagnosed(tmp_path, "--pick", rival, "--force")
    assert asked.exit_code == 2 and not (tmp_path / "new.yaml").exists()
    assert (
        f"--pick {rival}: its size is not known before the run that tells it from its rivals"
        in asked.stderr
    )
    assert asked.stdout.strip() and told["extended_machine"] is None
    asked, _told = diagnosed(tmp_path, "--pick", "flow.gain", "--force")
    assert asked.exit_code == 2
    assert f"--pick flow.gain: not found in this data; undecided: {cause['id']}" in asked.stderr


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--pick", "lag.offset"], "--pick lag.offset: only --adopt takes up a cause"),
        (
            ["--pick", "lag.ofset", "--adopt", "new.yaml"],
            "--pick lag.ofset: allowed are the names that `topdress effects` lists",
        ),
    ],
)
def test_a_pick_that_cannot_be_is_refused_before_the_work(
    tmp_path: Path, more: list[str], line: str
) -> None:
    asked = CliRunner().invoke(app, ["diagnose", str(lag_table(tmp_path / "one.csv", 0.3)), *more])
    assert (asked.exit_code, asked.stdout, asked.stderr.strip()) == (2, "", line)


def test_an_adoption_is_refused_by_the_scope_whatever_the_findings_say(tmp_path: Path) -> None:
    found = diagnose_tables(
        [read_bench_table(lag_table(tmp_path / "two.csv", 0.0, "blue", 0.3))], Machine()
    )
    (cause,) = found.causes
    assert cause.scope == "two.csv blue" and any(
        "two.csv blue only" in text for text in found.findings
    )
    reworded = replace(found, findings=("only the blue tractor's rows have it",))
    with pytest.raises(ValueError, match=r"holds for two\.csv blue only, not for the machine"):
        adopt_findings(reworded, Machine(), [tmp_path / "two.csv"], tmp_path / "new.yaml")
    assert not (tmp_path / "new.yaml").exists()
    assert sort_adoptable(reworded) == (
        (),
        (f"{cause.id}: holds in the rows of two.csv blue only",),
    )
    adopt_findings(
        replace(found, causes=(replace(cause, scope=None, rivals=()),)),
        Machine(),
        [tmp_path / "two.csv"],
        tmp_path / "new.yaml",
    )  # though a sentence still says where it holds
    assert (tmp_path / "new.yaml").exists()


def test_what_is_only_suspected_or_grew_is_not_adopted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = lag_table(tmp_path / "one.csv", 0.3)
    found = diagnose_tables([read_bench_table(table)], Machine())
    sure = replace(found.causes[0], id="lag.offset", probability=1.0, rivals=())
    suspected = replace(sure, id="shaft.gain", probability=0.5, rivals=(Rival(UNKNOWN, 0.5),))
    grown = replace(sure, id="lag.rebound", onset_s=10.0, grows=True)
    adopt_findings(
        replace(found, causes=(sure, suspected, grown)), Machine(), [table], tmp_path / "new.yaml"
    )
    said = capsys.readouterr().err
    assert "shaft.gain is not adopted: it may be something else" in said
    assert "lag.rebound is not adopted: grew during the run" in said
    assert f"{tmp_path / 'new.yaml'}, before -> after" in said and "lag.offset: 0 -> " in said
    assert [one.id for one in load_config(tmp_path / "new.yaml", MACHINE_KIND).model.adopted] == [
        "lag.offset"
    ]


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--job", "demo"], "--job demo: only --closed-loop simulates a job"),
        (["--job", "map_demo", "--closed-loop", "60"], "--job map_demo: target map"),
        (["--job", "nowhere.yaml", "--closed-loop", "60"], "nowhere.yaml"),
    ],
)
def test_a_job_is_simulated_or_refused_in_one_line(
    tmp_path: Path, more: list[str], line: str
) -> None:
    table = lag_table(tmp_path / "one.csv", 0.3)
    asked = CliRunner().invoke(app, ["diagnose", str(table), *more])
    assert asked.exit_code == 2 and line in asked.output
    assert "Traceback" not in asked.output

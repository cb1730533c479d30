"""`topdress compare`: two machine files on logs that neither was fitted to."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from topdress.control.diagnosis.runs.compared import calc_rms_interval
from topdress.control.machine.machine import Adopted, add_effect
from topdress.drivers.files.config import calc_sha256, load_config, save_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

from tests.command import topdress


def log_of(path: Path, gain: float, seed: int) -> Path:
    """Three minutes of a drive whose every speed is `gain` times its command, a row every 0.02
    s."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, 180.0, 0.02)
    command = np.repeat(rng.uniform(100.0, 600.0, 90).round(), 100)
    turned = np.concatenate((np.full(10, command[0]), command[:-10]))
    rows = np.column_stack(
        (time_s, command, gain * turned + 2.0 * rng.standard_normal(len(time_s)))
    )
    path.write_text(
        "time_s,shaft_rpm_cmd,shaft_rpm\n"
        + "\n".join(f"{t:.2f},{c:g},{y:.3f}" for t, c, y in rows)
        + "\n"
    )
    return path


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path, Path]:
    """The shipped drive, the drive with 5 % more, and a log of one that is truly 5 % faster."""
    nominal = load_config("drive_alone", MACHINE_KIND).model
    old, new = tmp_path / "old.yaml", tmp_path / "new.yaml"
    save_config(old, nominal, MACHINE_KIND)
    save_config(new, add_effect(nominal, "shaft.gain", 5.0), MACHINE_KIND)
    return old, new, log_of(tmp_path / "run.csv", 1.05, 1)


def test_the_better_file_is_said_with_its_interval(
    files: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    old, new, log = files
    other = log_of(tmp_path / "other.csv", 1.0, 2)
    done = topdress("compare", old, new, log, other, "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert set(told) == {"logs"} and [one["path"] for one in told["logs"]] == [str(log), str(other)]
    for one in told["logs"]:
        assert set(one) == {"path", "channels"}
        assert [set(c) for c in one["channels"]] == [
            {"channel", "unit", "old", "new", "low", "high"}
        ]
    better, worse = (one["channels"][0] for one in told["logs"])
    assert (better["channel"], better["unit"]) == ("shaft", "r/min")
    assert better["low"] < better["old"] - better["new"] < better["high"]
    assert better["low"] > 0.0 and worse["high"] < 0.0


def test_what_a_machine_does_not_have_is_not_missed(files: tuple[Path, Path, Path]) -> None:
    old, new, log = files
    for path in (old, new):
        save_config(
            path,
            load_config(str(path), MACHINE_KIND).model.model_copy(update={"stages": ("shaft",)}),
            MACHINE_KIND,
        )
    done = topdress("compare", old, new, log)
    assert done.exit_code == 0 and "cannot be diagnosed" not in done.stderr, done.stderr


def test_in_words_and_as_a_page(files: tuple[Path, Path, Path], tmp_path: Path) -> None:
    old, new, log = files
    page = tmp_path / "page.html"
    done = topdress("compare", old, new, log, "--report", page)
    assert done.exit_code == 0, done.output
    assert "shaft" in done.stdout and "new is better" in done.stdout
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") == 1 and "old machine file" in text and "1 better, 0 worse" in text
    again = topdress("compare", old, new, log, "--report", log)
    assert again.exit_code == 2 and "is read" in again.output


def test_a_log_that_the_file_was_made_from_is_said(files: tuple[Path, Path, Path]) -> None:
    old, new, log = files
    machine = load_config(str(new), MACHINE_KIND).model
    adopted = Adopted(id="shaft.gain", size=5.0, sha256=calc_sha256(log))
    save_config(new, machine.model_copy(update={"adopted": (adopted,)}), MACHINE_KIND)
    done = topdress("compare", old, new, log)
    assert done.exit_code == 0 and "fitted to this very log" in done.output


def test_what_cannot_be_compared(files: tuple[Path, Path, Path], tmp_path: Path) -> None:
    old, new, log = files
    rates = tmp_path / "rates.csv"
    rates.write_text(
        "time_s,target_rate_kg_ha\n" + "".join(f"{k},{100 + k % 3}\n" for k in range(100))
    )
    none = topdress("compare", old, new, rates, "--json")
    assert none.exit_code == 3 and json.loads(none.stdout) == {
        "logs": [{"path": str(rates), "channels": []}]
    }
    gone = topdress("compare", old, tmp_path / "gone.yaml", log)
    assert gone.exit_code == 2 and len(gone.output.splitlines()) == 1


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    """300 pairs of correlated errors of known sizes."""
    rng, held = np.random.default_rng(3), 0
    for _ in range(300):
        noise = np.convolve(rng.standard_normal(2019), np.ones(20) / np.sqrt(20.0), "valid")
        low, high = calc_rms_interval(noise + np.sin(np.arange(2000) / 30.0), noise)
        held += low < np.sqrt(1.5) - 1.0 < high
    assert 0.84 <= held / 300 <= 0.96


def test_of_the_same_file_the_difference_is_nought(files: tuple[Path, Path, Path]) -> None:
    old, _, log = files
    done = topdress("compare", old, old, log, "--json")
    one = json.loads(done.stdout)["logs"][0]["channels"][0]
    assert one["old"] == one["new"] and one["low"] == one["high"] == 0.0

"""The commands as a user meets them: output, files, one plain line for what is wrong, the exit
code."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.cli import screens
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.screens import is_first_time
from topdress.console.running import WorkerAddress
from topdress.console.services.launcher import Launcher
from topdress.control.log_row import COLUMNS
from topdress.control.machine.fall import calc_drop_s as drop_time_s
from topdress.control.machine.history import append_history
from topdress.control.machine.machine import CATALOGUE, Machine, add_effect, list_effect_sizes
from topdress.control.machine.terms import Term
from topdress.control.metering.pair_planner import PLAN_BAND_MM_SHARE
from topdress.drivers.files import run_setup
from topdress.drivers.files.config import load_config, save_config
from topdress.drivers.files.config_error import ConfigError
from topdress.drivers.files.config_kinds import JOB_KIND, MACHINE_KIND

from tests.command import topdress

ROOT = Path(__file__).parents[2]


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "a.csv"
    result = topdress("simulate", "--seconds", "90", "--seed", "3", "--out", path)
    assert result.exit_code == 0, result.output
    return path


def test_simulate_writes_log_yaml_and_truth(log: Path) -> None:
    rows = rows_of(log)
    assert len(rows) == 1800
    assert tuple(rows[0]) == COLUMNS
    assert float(rows[0]["time_s"]) == 0.0
    assert float(rows[-1]["time_s"]) == pytest.approx(89.95)
    assert rows[-1]["state"] == "working"
    truth = rows_of(log.with_name("a.truth.csv"))
    assert len(truth) == 1800
    assert {"shaft_rpm", "opening_mm", "flow_kg_s", "landed_rate_kg_ha", "landed_place_m"} <= set(
        truth[0]
    )
    assert float(truth[0]["time_s"]) == pytest.approx(0.05)
    time, place = ([float(row[name]) for row in truth] for name in ("time_s", "place_m"))
    steady = [
        k
        for k in range(900, 1700)
        if all(float(truth[k + d]["shaft_rpm"]) == 70.0 for d in (-1, 0, 20))
    ]
    drop_s = drop_time_s(Machine().fall, 70.0)
    # let go from the step's begin on, not from its end
    for k in steady[::50]:
        lands = float(np.interp(time[k] - 0.05 + drop_s, time, place))
        assert float(truth[k]["landed_place_m"]) == pytest.approx(lands, abs=0.003)
    assert len(steady) > 200
    assert log.with_suffix(".yaml").read_text().startswith("format: topdress-run-log/1")
    assert not list(log.parent.glob(".*"))


def test_one_seed_one_log(log: Path, tmp_path: Path) -> None:
    again = tmp_path / "a.csv"
    topdress("simulate", "--seconds", "90", "--seed", "3", "--out", again)
    assert again.read_bytes() == log.read_bytes()
    assert again.with_name("a.truth.csv").read_bytes() == log.with_name("a.truth.csv").read_bytes()


def test_headless_replay_decides_as_it_was_decided(log: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.csv"
    result = topdress("replay", log, "--headless", "--out", new)
    assert result.exit_code == 0, result.output
    old_rows, new_rows = rows_of(log), rows_of(new)
    assert [r["state"] for r in new_rows] == [r["state"] for r in old_rows]
    pairs = [
        (float(a["opening_mm_cmd"]), float(b["opening_mm_cmd"]))
        for a, b in zip(old_rows, new_rows, strict=True)
    ]
    same = sum(abs(a - b) <= PLAN_BAND_MM_SHARE * max(a, b) + 0.1 for a, b in pairs) / len(pairs)
    # the log's rounding may tip a dead band one tick sooner or later, never more than a band
    assert same > 0.98
    assert sum(a for a, _ in pairs) == pytest.approx(sum(b for _, b in pairs), rel=0.002)


def test_replay_with_another_strategy_moves_the_other_drive(log: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.csv"
    result = topdress("replay", log, "--headless", "--out", new, "--strategy", "speed_first")
    assert result.exit_code == 0, result.output
    late = [float(r["opening_mm_cmd"]) for r in rows_of(new)[-600:]]
    assert max(late) - min(late) < 2.5
    assert {r["strategy"] for r in rows_of(new)[1:]} == {"speed_first"}


@pytest.mark.exam
def test_balanced_is_read_as_opening_first_and_said(log: Path, tmp_path: Path) -> None:
    """A word of older job files: at each door where it was accepted."""
    job, said = tmp_path / "old.yaml", "note: strategy balanced: works as opening_first"
    save_config(
        job,
        load_config("demo", JOB_KIND).model.model_copy(update={"strategy": "balanced"}),
        JOB_KIND,
        "",
    )
    word = ["--strategy", "balanced"]
    simulate = ["simulate", "--seconds", "3"]
    for k, (command, has) in enumerate(
        [
            (simulate, word),
            (simulate, ["--job", str(job)]),
            (["replay", str(log), "--headless"], word),
        ]
    ):
        out = tmp_path / f"{k}.csv"
        result = topdress(*command, *has, "--out", out)
        assert result.exit_code == 0 and result.output.count(said) == 1, result.output
        assert {r["strategy"] for r in rows_of(out)[1:]} == {"opening_first"}
    result = topdress("check", job)
    assert result.exit_code == 0 and result.output.count(said) == 1


def test_summary_as_json() -> None:
    result = topdress(
        "simulate",
        "--seconds",
        "40",
        "--effect",
        "flow.gain=8",
        "--summary",
        "--json",
        "--look-ahead",
        "off",
        "--strategy",
        "speed_first",
    )
    told = json.loads(result.output)
    assert told["strategy"] == "speed_first"
    assert told["look_ahead"] is False
    assert told["effects"] == ["flow.gain=8"]
    assert told["place_bias_m"] > 1.0
    assert told["landed_kg"] == pytest.approx(told["released_kg"])
    assert told["graded_error_percent"] > 0.0 < told["smooth_error_percent"]


def test_the_summary_says_against_what() -> None:
    said = topdress("simulate", "--seconds", "40", "--summary").output
    for words in ("against what was held", "against the graded need", "against the smooth need"):
        assert said.count(words) == 1
    plain = topdress("simulate", "--seconds", "20", "--job", "map_demo", "--summary").output
    assert "against what was held" in plain and "need of the canopy" not in plain


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["simulate", "--effect", "flow.gian=8"], "flow.gian"),
        (["simulate", "--effect", "flow.gain=900"], "allowed -60 to 100"),
        (["simulate", "--effect", "canopy.head_fouled=-5"], "#1 to #6"),
        (["simulate", "--look-ahead", "maybe"], "allowed on or off"),
        (
            [
                "simulate",
                "--machine",
                "spreader",
                "--job",
                "spreader_demo",
                "--effect",
                "gate.offset=70",
            ],
            "gate.offset: size 70: allowed -66.6667 to 66.6667",
        ),
        (
            [
                "simulate",
                "--machine",
                "spreader",
                "--job",
                "spreader_demo",
                "--effect",
                "gate.offset=70",
            ],
            "where limits.opening_high_mm is 200",
        ),
        # was a fault of ours, OverflowError
        (["simulate", "--seconds", "inf"], "allowed is a number, not"),
        (
            ["calibrate", "lag", "table.csv", "--out", "new.yaml", "--from-rpm", "nan"],
            "allowed is a number, not",
        ),
        (["map", "in.zip", "--out", "out.geojson", "--scale", "inf"], "allowed is a number, not"),
        (["map", "in.zip", "--out", "out.geojson", "--outside", "nan"], "allowed is a number, not"),
        (["simulate", "--machine", "huanghia"], "huanghai"),
        (["replay", "nothing.csv", "--headless", "--out", "x.csv"], "nothing.csv"),
        (["decode", "morse", "pyproject.toml"], "morse"),
        (["decode", "gnss", "nothing.log"], "nothing.log"),
        (["check", "no_such_name"], "no_such_name"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(arguments: list[str], said: str) -> None:
    result = topdress(*arguments)
    lines = [line for line in result.output.splitlines() if line.strip()]
    assert result.exit_code == 2 and len(lines) == 1 and said in lines[0], result.output


def test_check_says_ok_for_everything_shipped() -> None:
    from topdress.drivers.files.config import find_shipped_files

    names = [
        name
        for folder in ("machines", "crops", "products", "jobs")
        for name in find_shipped_files(folder)
    ]
    assert len(names) >= 8
    result = topdress("check", *names)
    assert result.exit_code == 0, result.output
    assert result.output.count(": ok (") == len(names)
    assert all(
        "typical figures" in find_shipped_files("machines")[name].read_text(encoding="utf-8")
        for name in ("drive_alone", "planter", "spreader")
    )


def test_check_says_what_a_silent_display_gives(tmp_path: Path) -> None:
    job, note = tmp_path / "outside.yaml", "nothing is spread while the other display is silent"
    for key, is_said in (("", True), (", external_silent_kg_ha: 0", False)):
        job.write_text(f"format: topdress-job/1\nid: a\ntarget: {{source: external{key}}}\n")
        checked = topdress("check", job)
        assert checked.exit_code == 0 and (note in checked.output) == is_said


def test_check_names_key_value_and_range(tmp_path: Path) -> None:
    bad = tmp_path / "m.yaml"
    bad.write_text("format: topdress-machine/1\nflow: {gain_percent: 700}\n")
    result = topdress("check", bad)
    assert result.exit_code == 2
    assert "flow.gain_percent" in result.output
    assert "700" in result.output
    assert "-60 to 100" in result.output


def test_effects_lists_the_catalogue() -> None:
    listed = json.loads(topdress("effects", "--json").output)
    assert len(listed) == 56
    assert topdress("effects").output.count("tell apart:") == len(CATALOGUE)


def test_info_and_extras_say_what_is_here() -> None:
    told = json.loads(topdress("info", "--json").output)
    assert told["topdress"]["textual"][0].isdigit() and told["folders"]["settings"].endswith(
        "settings.yaml"
    )
    assert topdress("info").output.count("\n") > 25
    extras = {one["extra"]: one for one in json.loads(topdress("extras", "--json").output)}
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    assert set(extras) == set(declared) - {"dev"} and "'rasterio>=" in extras["raster"]["line"]


def test_decode_counts(tmp_path: Path) -> None:
    capture = tmp_path / "c.log"
    good = b"$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n"
    capture.write_bytes(good + good[:-4] + b"77\r\n")
    result = topdress("decode", "gnss", capture, "--json")
    counts: dict[str, Any] = json.loads(result.output.splitlines()[-1])["counts"]
    assert counts["read"] == 2
    assert counts["accepted"] == 1
    assert counts["rejected"] == {"bad_checksum": 1}


def test_cancelling_leaves_nothing_half_written(tmp_path: Path) -> None:
    import signal
    import time

    out = tmp_path / "long.csv"
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "from topdress.console.cli import main; main()",
            "simulate",
            "--seconds",
            "100000",
            "--out",
            str(out),
        ],
        stderr=subprocess.PIPE,
    )
    for _ in range(200):
        time.sleep(0.1)
        if list(tmp_path.glob(".long*.csv")):
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    try:
        _, said = process.communicate(timeout=30)
    finally:
        # A command that goes on would take a processor for an hour.
        process.kill()
    assert process.returncode == 130
    assert b"cancelled" in said
    assert list(tmp_path.iterdir()) == []


def test_cancelled_as_its_files_begin_it_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cancelled(file: object, data: bytearray) -> None:
        assert (tmp_path / ".a.part.yaml").exists()
        raise KeyboardInterrupt

    monkeypatch.setattr("topdress.drivers.files.run_log._write_all_bytes", cancelled)
    done = topdress("simulate", "--seconds", "2", "--out", tmp_path / "a.csv")
    assert done.exit_code == 130 and list(tmp_path.iterdir()) == []


def test_diagnose_tells_a_bench_table_apart_from_a_run(tmp_path: Path) -> None:
    table = tmp_path / "lag.csv"
    rows = [
        f"{rpm},{2.2118 - 0.0083 * rpm + 0.3 + 0.01 * k:.3f}"
        for rpm in range(10, 80, 10)
        for k in (-1, 0, 1)
    ]
    table.write_text("shaft_rpm,lag_s\n" + "\n".join(rows) + "\n")
    out = tmp_path / "found.json"
    result = topdress("diagnose", table, "--json", out)
    assert result.exit_code == 0, result.output
    found = json.loads(out.read_text())
    assert found["format"] == "topdress-diagnosis/1"
    assert found["data"]["kind"] == "lag"
    assert found["causes"][0]["id"] in {"lag.offset", "shaft.dead_time"}
    assert {
        "data",
        "channels",
        "verdict",
        "causes",
        "not_shown",
        "unexplained",
        "next_run",
        "gain",
        "extended_machine",
    } <= set(found)


# --- The tour comes once
# ---------------------------------------------------------------------------------------------


def test_only_the_first_time_is_the_first(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert [is_first_time() for _ in range(3)] == [True, False, False]


def test_a_folder_that_cannot_be_written_is_no_reason_to_fail(tmp_path, monkeypatch):
    (tmp_path / "data").write_text("a file where a folder should be")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert not is_first_time()


# --- Numbers on the command line: nan and inf are none, whichever option takes one
# -----------------------------------


@pytest.mark.parametrize(
    "given", ["simulate --seconds 12,5", "simulate --seconds 5 --effect flow.gain=8,5"]
)
def test_a_comma_is_refused_and_never_dropped(given: str) -> None:
    said = topdress(*given.split())
    assert said.exit_code == 2 and (
        "12,5" in said.output or "8,5" in said.output or "number" in said.output
    )


# --- `topdress history`: what was changed, before and after; --undo writes the file without the
# last of it -----------

TERM = Term.model_validate(
    {
        "id": "flow.slope_roll_deg",
        "acts_on": "flow_percent",
        "form": "slope",
        "over": ({"name": "roll_deg", "valid": (-4.0, 4.0)},),
        "coefficients": {"slope": -0.5},
    }
)


@pytest.fixture
def extended(tmp_path: Path) -> Path:
    path = tmp_path / "new.yaml"
    after = add_effect(Machine(), "flow.gain", 3.0).model_copy(update={"terms": (TERM,)})
    save_config(
        path, append_history(Machine(), after, data="run.csv", date="2026-07-09"), MACHINE_KIND
    )
    return path


def test_it_says_both_sides(extended: Path) -> None:
    said = topdress("history", extended)
    assert said.exit_code == 0
    assert "2026-07-09, from run.csv" in said.output
    assert "flow.gain: 0 -> 3 %" in said.output
    assert f"{TERM.id}: none -> Flow falls by 0.5 % for each deg of roll" in said.output


def test_undo_writes_another_file(extended: Path, tmp_path: Path) -> None:
    before = extended.read_bytes()
    said = topdress("history", extended, "--undo", "--out", tmp_path / "back.yaml")
    assert said.exit_code == 0
    assert extended.read_bytes() == before
    back = load_config(str(tmp_path / "back.yaml"), MACHINE_KIND).model
    assert (list_effect_sizes(back), back.terms) == ({}, ())
    assert "taken back" in topdress("history", tmp_path / "back.yaml").output


@pytest.mark.parametrize("words", [["--undo"], ["--out", "x.yaml"]])
def test_the_file_itself_is_never_written_over(extended: Path, words: list[str]) -> None:
    said = topdress("history", extended, *words)
    assert said.exit_code != 0


def test_a_shipped_machine_has_none() -> None:
    said = topdress("history", "huanghai")
    assert said.exit_code == 0
    assert said.output == "huanghai: no diagnosis changed this file\n"


# --- `topdress run` before its first picture: the worker comes up beside the console; wrong
# files are told as... -----


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """What is done, in its order; no screen is drawn and no worker runs."""
    done: list[str] = []
    setup_of = run_setup.build_setup

    def start(self: Launcher, resumed: Path | None = None) -> WorkerAddress:
        done.append("worker")
        return WorkerAddress(1, None, 1)

    def read(*args: Any) -> run_setup.Setup:
        done.append("files")
        return setup_of(*args)

    monkeypatch.setattr(screens, "has_terminal", lambda: True)
    monkeypatch.setattr(screens, "need_terminal", lambda *words: None)
    monkeypatch.setattr(screens, "make_trouble_path", lambda: tmp_path / "worker.log")
    monkeypatch.setattr(screens, "is_first_time", lambda: False)
    monkeypatch.setattr("topdress.console.running.find_running_worker", lambda: None)
    monkeypatch.setattr(Launcher, "start_process", start)
    monkeypatch.setattr(run_setup, "build_setup", read)
    monkeypatch.setattr(TopdressApp, "run", lambda self: done.append("screen"))
    return done


def test_the_worker_comes_up_first_and_no_picture_waits_for_the_files(
    steps: list[str], tmp_path: Path
) -> None:
    screens.show_run((), (), 1, 20.0, str(tmp_path / "run.csv"))
    assert sorted(steps) == ["screen", "worker"]


def test_a_wrong_file_is_told_as_a_file(
    steps: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that is wrong with it, where the worker's last words are one line."""

    def run(self: TopdressApp) -> None:
        self.not_started = "the machine did not start: something else"

    monkeypatch.setattr(TopdressApp, "run", run)
    wrong = tmp_path / "job.yaml"
    wrong.write_text("format: topdress-job/1\ncolour: red\n")
    with pytest.raises(ConfigError, match="colour"):
        screens.show_run((str(wrong),), (), 1, 20.0, str(tmp_path / "run.csv"))


def test_a_worker_that_did_not_come_up_is_one_line(
    steps: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(self: TopdressApp) -> None:
        self.not_started = "the machine did not start: no such port"

    monkeypatch.setattr(TopdressApp, "run", run)
    with pytest.raises(CommandError, match="no such port"):
        screens.show_run((), (), 1, 20.0, str(tmp_path / "run.csv"))


@pytest.mark.parametrize("quit_by_order", ["false", "true"])
def test_a_job_that_was_left_is_asked_about_first(
    quit_by_order: str, steps: list[str], tmp_path: Path
) -> None:
    kept = f'{{"format": "topdress-resume/1", "quit": {quit_by_order}}}'
    (tmp_path / "left.resume.json").write_text(kept)
    assert Launcher(
        (), (), 1, 20.0, str(tmp_path / "run.csv"), tmp_path / "trouble"
    ).may_have_offer()
    (tmp_path / "left.resume.json").write_text(kept.replace("}", ', "finished": true}'))
    assert not Launcher(
        (), (), 1, 20.0, str(tmp_path / "run.csv"), tmp_path / "trouble"
    ).may_have_offer()

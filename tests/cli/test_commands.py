"""The commands as a user meets them: output, files, one plain line for what is wrong, the exit code."""
from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from console.cli import app
from control.log_row import COLUMNS
from control.machine.fall import drop_s as drop_time_s
from control.machine.machine import CATALOGUE, Machine
from control.metering.plan import OPENING_BAND_SHARE

runner = CliRunner()


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "a.csv"
    result = runner.invoke(app, ["simulate", "--seconds", "90", "--seed", "3", "--out", str(path)])
    assert result.exit_code == 0, result.output
    return path


def test_help_lists_every_command() -> None:
    text = runner.invoke(app, ["--help"]).output
    for command in ("run", "replay", "simulate", "effects", "decode", "check"):
        assert command in text


def test_simulate_writes_log_yaml_and_truth(log: Path) -> None:
    rows = rows_of(log)
    assert len(rows) == 1800
    assert tuple(rows[0]) == COLUMNS
    assert float(rows[0]["time_s"]) == 0.0
    assert float(rows[-1]["time_s"]) == pytest.approx(89.95)
    assert rows[-1]["state"] == "working"
    truth = rows_of(log.with_name("a.truth.csv"))
    assert len(truth) == 1800
    assert {"shaft_rpm", "opening_mm", "flow_kg_s", "landed_rate_kg_ha", "landed_place_m"} <= set(truth[0])
    assert float(truth[0]["time_s"]) == pytest.approx(0.05)
    time, place = ([float(row[name]) for row in truth] for name in ("time_s", "place_m"))
    steady = [k for k in range(900, 1700) if all(float(truth[k + d]["shaft_rpm"]) == 70.0 for d in (-1, 0, 20))]
    drop_s = drop_time_s(Machine().fall, 70.0)
    for k in steady[::50]:      # let go from the step's begin on, not from its end
        lands = float(np.interp(time[k] - 0.05 + drop_s, time, place))
        assert float(truth[k]["landed_place_m"]) == pytest.approx(lands, abs=0.003)
    assert len(steady) > 200
    assert log.with_suffix(".yaml").read_text().startswith("format: topdress-run-log/1")
    assert not list(log.parent.glob(".*"))


def test_one_seed_one_log(log: Path, tmp_path: Path) -> None:
    again = tmp_path / "a.csv"
    runner.invoke(app, ["simulate", "--seconds", "90", "--seed", "3", "--out", str(again)])
    assert again.read_bytes() == log.read_bytes()
    assert again.with_name("a.truth.csv").read_bytes() == log.with_name("a.truth.csv").read_bytes()


def test_headless_replay_decides_as_it_was_decided(log: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.csv"
    result = runner.invoke(app, ["replay", str(log), "--headless", "--out", str(new)])
    assert result.exit_code == 0, result.output
    old_rows, new_rows = rows_of(log), rows_of(new)
    assert [r["state"] for r in new_rows] == [r["state"] for r in old_rows]
    pairs = [(float(a["opening_mm_cmd"]), float(b["opening_mm_cmd"])) for a, b in zip(old_rows, new_rows, strict=True)]
    same = sum(abs(a - b) <= OPENING_BAND_SHARE * max(a, b) + 0.1 for a, b in pairs) / len(pairs)
    assert same > 0.98      # the log's rounding may tip a dead band one tick sooner or later, never more than a band
    assert sum(a for a, _ in pairs) == pytest.approx(sum(b for _, b in pairs), rel=0.002)


def test_replay_with_another_strategy_moves_the_other_drive(log: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.csv"
    result = runner.invoke(app, ["replay", str(log), "--headless", "--out", str(new), "--strategy", "speed_first"])
    assert result.exit_code == 0, result.output
    late = [float(r["opening_mm_cmd"]) for r in rows_of(new)[-600:]]
    assert max(late) - min(late) < 2.5
    assert {r["strategy"] for r in rows_of(new)[1:]} == {"speed_first"}


def test_summary_as_json() -> None:
    result = runner.invoke(app, ["simulate", "--seconds", "40", "--effect", "flow.gain=8", "--summary", "--json",
                                 "--look-ahead", "off", "--strategy", "speed_first"])
    told = json.loads(result.output)
    assert told["strategy"] == "speed_first"
    assert told["look_ahead"] is False
    assert told["effects"] == ["flow.gain=8"]
    assert told["place_bias_m"] > 1.0
    assert told["landed_kg"] == pytest.approx(told["released_kg"])
    assert told["graded_error_percent"] > 0.0 < told["smooth_error_percent"]


def test_the_summary_says_against_what() -> None:
    said = runner.invoke(app, ["simulate", "--seconds", "40", "--summary"]).output
    for words in ("against what was held", "against the graded need", "against the smooth need"):
        assert said.count(words) == 1
    plain = runner.invoke(app, ["simulate", "--seconds", "20", "--job", "map_demo", "--summary"]).output
    assert "against what was held" in plain and "need of the canopy" not in plain


@pytest.mark.parametrize(("arguments", "said"), [
    (["simulate", "--effect", "flow.gian=8"], "flow.gian"),
    (["simulate", "--effect", "flow.gain=900"], "allowed -60 to 100"),
    (["simulate", "--effect", "canopy.head_fouled=-5"], "#1 to #6"),
    (["simulate", "--look-ahead", "maybe"], "allowed on or off"),
    (["simulate", "--machine", "huanghia"], "huanghai"),
    (["replay", "nothing.csv", "--headless", "--out", "x.csv"], "nothing.csv"),
    (["decode", "morse", "pyproject.toml"], "morse"),
    (["decode", "gnss", "nothing.log"], "nothing.log"),
    (["check", "no_such_name"], "no_such_name")])
def test_what_is_wrong_is_said_in_one_line(arguments: list[str], said: str) -> None:
    result = runner.invoke(app, arguments)
    assert result.exit_code != 0
    lines = [line for line in result.output.splitlines() if line.strip()]
    assert len(lines) == 1
    assert said in lines[0]
    assert "Traceback" not in result.output


def test_check_says_ok_for_everything_shipped() -> None:
    from drivers.files.config import shipped
    names = [name for folder in ("machines", "crops", "products", "jobs") for name in shipped(folder)]
    assert len(names) >= 8
    result = runner.invoke(app, ["check", *names])
    assert result.exit_code == 0, result.output
    assert result.output.count(": ok (") == len(names)


def test_check_names_key_value_and_range(tmp_path: Path) -> None:
    bad = tmp_path / "m.yaml"
    bad.write_text("format: topdress-machine/1\nflow: {gain_percent: 700}\n")
    result = runner.invoke(app, ["check", str(bad)])
    assert result.exit_code == 2
    assert "flow.gain_percent" in result.output
    assert "700" in result.output
    assert "-60 to 100" in result.output


def test_effects_lists_the_catalogue() -> None:
    listed = json.loads(runner.invoke(app, ["effects", "--json"]).output)
    assert len(listed) == 48
    assert runner.invoke(app, ["effects"]).output.count("tell apart:") == len(CATALOGUE)


def test_decode_counts(tmp_path: Path) -> None:
    capture = tmp_path / "c.log"
    good = b"$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n"
    capture.write_bytes(good + good[:-4] + b"77\r\n")
    result = runner.invoke(app, ["decode", "gnss", str(capture), "--json"])
    counts: dict[str, Any] = json.loads(result.output.splitlines()[-1])["counts"]
    assert counts["read"] == 2
    assert counts["accepted"] == 1
    assert counts["rejected"] == {"bad_checksum": 1}


def test_cancelling_leaves_nothing_half_written(tmp_path: Path) -> None:
    import signal
    import time
    out = tmp_path / "long.csv"
    process = subprocess.Popen([sys.executable, "-c", "from console.cli import main; main()", "simulate", "--seconds",
                                "100000", "--out", str(out)], stderr=subprocess.PIPE)
    for _ in range(200):
        time.sleep(0.1)
        if list(tmp_path.glob(".long*.csv")):
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert b"cancelled" in said
    assert list(tmp_path.iterdir()) == []


def test_a_foreign_control_package_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from console import cli
    monkeypatch.setattr(cli, "_foreign", lambda doc: True)
    monkeypatch.delattr("control.log_row")
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 1
    assert "environment of its own" in capsys.readouterr().err


def test_calibrate_writes_a_new_machine_file_and_never_overwrites(tmp_path: Path) -> None:
    table = tmp_path / "catch.csv"
    lines = [f"{rpm},{mm},60,{5.9e-3 * mm * rpm * (1.0 + 0.001 * k):.4f}"
             for rpm in (30, 60) for mm in (10, 20, 40) for k in (-1, 0, 1)]
    table.write_text("shaft_rpm,opening_mm,duration_s,mass_kg\n" + "\n".join(lines) + "\n")
    out = tmp_path / "new.yaml"
    result = runner.invoke(app, ["calibrate", "catch", str(table), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "5.9" in result.output
    assert runner.invoke(app, ["check", str(out)]).exit_code == 0
    again = runner.invoke(app, ["calibrate", "catch", str(table), "--out", str(out)])
    assert again.exit_code == 2
    assert "nothing is overwritten" in again.output


def test_diagnose_never_writes_over_data_or_an_existing_file(log: Path) -> None:
    sidecar = log.with_suffix(".yaml")
    before = sidecar.read_bytes()
    for option in ("--adopt", "--report", "--json"):
        result = runner.invoke(app, ["diagnose", str(log), option, str(sidecar)])
        assert result.exit_code == 2, option
        assert sidecar.name in result.output
    assert sidecar.read_bytes() == before


def test_diagnose_tells_a_bench_table_apart_from_a_run(tmp_path: Path) -> None:
    table = tmp_path / "lag.csv"
    rows = [f"{rpm},{2.2118 - 0.0083 * rpm + 0.3 + 0.01 * k:.3f}" for rpm in range(10, 80, 10) for k in (-1, 0, 1)]
    table.write_text("shaft_rpm,lag_s\n" + "\n".join(rows) + "\n")
    out = tmp_path / "found.json"
    result = runner.invoke(app, ["diagnose", str(table), "--json", str(out)])
    assert result.exit_code == 0, result.output
    found = json.loads(out.read_text())
    assert found["format"] == "topdress-diagnosis/1"
    assert found["data"]["kind"] == "lag"
    assert found["causes"][0]["id"] in {"lag.offset", "shaft.dead_time"}
    assert {"data", "channels", "verdict", "causes", "not_shown", "unexplained", "next_run", "gain",
            "extended_machine"} <= set(found)

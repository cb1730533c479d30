"""Every command over a folder of broken files: one plain line and no success, never a traceback."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from topdress.control.log_row import COLUMNS

from tests.command import topdress

CATCH = "shaft_rpm,opening_mm,duration_s,mass_kg\n"
LAG = "shaft_rpm,lag_s\n"


def archive(*names: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as opened:
        for name in names:
            opened.writestr(name, "<?xml version='1.0'?><x/>")
    return packed.getvalue()


BROKEN: dict[str, bytes | None] = {  # None: a folder
    "missing": b"",
    "empty": b"",
    "blank": b"\n\n  \n",
    "log_header": (",".join(COLUMNS) + "\n").encode(),
    "catch_header": CATCH.encode(),
    "lag_header": LAG.encode(),
    "text": b"This is a letter to my uncle.\nIt has no columns.\n",
    "binary": bytes(range(256)) * 64,
    "zeros": bytes(5000),
    "folder": None,
    "wrong_columns": b"apples,pears\n1,2\n3,4\n",
    "text_cells": b"time_s,speed_mps\nmorning,slow\nnoon,fast\n",
    "catch_of_words": CATCH.encode() + b"slow,wide,long,much\n",
    "twins": b"time_s,time_s\n0,0\n1,1\n",
    "time_stands": b"time_s,speed_mps\n5,1\n5,1\n5,1\n",  # newest first is read, and noted
    "utf16": "Äpfel,Birnen\n1,2\n".encode("utf-16"),
    "gb18030": "苹果,梨\n一,二\n".encode("gb18030"),
    "latin1": "Äpfel;Birnen\nä;ö\n".encode("latin-1"),
    "half_utf8": "苹果,梨\n1,2\n".encode()[:-7] + b"\xe8",
    "yaml_list": b"- 1\n- 2\n",
    "yaml_bomb": b"a: &a [1]\nb: *a\nformat: [" + b"[" * 300,
    "json": b'{"type": "FeatureCollection", "features": 7}',
    "json_cut": b'{"type": "FeatureCollection", "features": [{"ty',
    "zip": archive("readme.txt"),
    "zip_cut": archive("TASKDATA.XML", "more")[:60],
    "task_zip": archive("TASKDATA/TASKDATA.XML"),
    "xlsx": archive("[Content_Types].xml", "xl/workbook.xml", "xl/worksheets/sheet1.xml"),
    "one_long_line": b"x" * 200_000,
}
ENDINGS = (".csv", ".yaml", ".geojson", ".shp", ".zip", ".xml", ".xlsx", "")
COMMANDS: dict[str, Callable[[str], list[str]]] = {
    "simulate job": lambda f: ["simulate", "--job", f, "--seconds", "1"],
    "simulate machine": lambda f: ["simulate", "--machine", f, "--seconds", "1"],
    "replay": lambda f: ["replay", f],
    "replay headless": lambda f: ["replay", f, "--headless", "--out", "out.csv"],
    "replay machine": lambda f: [
        "replay",
        "good.csv",
        "--headless",
        "--out",
        "out.csv",
        "--machine",
        f,
    ],
    "diagnose": lambda f: ["diagnose", f],
    "diagnose run": lambda f: ["diagnose", f, "--kind", "run"],
    "diagnose lag": lambda f: ["diagnose", f, "--kind", "lag"],
    "diagnose catch": lambda f: ["diagnose", f, "--kind", "catch"],
    "diagnose machine": lambda f: ["diagnose", "good.csv", "--machine", f],
    "decode gnss": lambda f: ["decode", "gnss", f],
    "decode board": lambda f: ["decode", "board", f],
    "history": lambda f: ["history", f],
    "effects machine": lambda f: ["effects", "--machine", f],
    "import": lambda f: ["import", f, "--out", "out.csv"],
    "import guess": lambda f: ["import", f, "--guess", "--mapping", "out.import.yaml"],
    "import mapping": lambda f: ["import", "good.csv", "--mapping", f, "--out", "out.csv"],
    "replay job": lambda f: ["replay", "good.csv", "--headless", "--out", "out.csv", "--job", f],
    "diagnose job": lambda f: ["diagnose", "good.csv", "--closed-loop", "60", "--job", f],
    "map machine": lambda f: ["map", "good.csv", "--out", "out.csv", "--machine", f],
    "serve-machine job": lambda f: ["serve-machine", "--job", f, "--port", "0", "--seconds", "0.1"],
    "calibrate catch": lambda f: ["calibrate", "catch", f, "--out", "out.yaml"],
    "calibrate lag": lambda f: ["calibrate", "lag", f, "--out", "out.yaml"],
    "calibrate wheel": lambda f: ["calibrate", "wheel", f, "--out", "out.yaml"],
    "calibrate effort": lambda f: ["calibrate", "effort", f, "--out", "out.yaml"],
    "calibrate heads": lambda f: ["calibrate", "heads", f, "--out", "out.yaml"],
    "map": lambda f: ["map", f, "--out", "out.geojson"],
    "check": lambda f: ["check", f],
    "run": lambda f: ["run", "--config", f],
    "serve-machine": lambda f: ["serve-machine", "--machine", f, "--port", "0", "--seconds", "0.1"],
}
# a capture may hold anything: then it counts what it refused
READS_ANYTHING = {"decode gnss", "decode board"}
OF_CONFIGURATION = {
    "history",
    "effects machine",
    "import mapping",
    "replay job",
    "diagnose job",
    "map machine",
    "serve-machine job",
    "simulate job",
    "simulate machine",
    "replay machine",
    "diagnose machine",
    "check",
    "run",
    "serve-machine",
}
WORDS_OF_A_BUG = (
    "KeyError",
    "TypeError",
    "IndexError",
    "AttributeError",
    "Errno",
    "errors.pydantic",
    "not supported",
    "index ",
    "NoneType",
    "object has no",
    "Traceback",
    "a fault of topdress",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("broken")
    for name, data in BROKEN.items():
        for ending in ENDINGS:
            if data is None:
                (place / f"{name}{ending}").mkdir()
            elif name != "missing":
                (place / f"{name}{ending}").write_bytes(data)
    done = topdress("simulate", "--seconds", "5", "--out", place / "good.csv")
    assert done.exit_code == 0
    return place


QUICK = {"simulate job", "diagnose", "import", "import mapping", "check"}  # readers apart


def endings_of(command: str) -> tuple[str, ...]:
    return ENDINGS if command == "map" else (".yaml",) if command in OF_CONFIGURATION else (".csv",)


@pytest.mark.parametrize(
    ("command", "endings"),
    [
        ("map", (".geojson", ".zip")),
        *(
            pytest.param(name, endings_of(name), marks=() if name in QUICK else pytest.mark.exam)
            for name in sorted(COMMANDS)
        ),
    ],
    ids=lambda one: one if isinstance(one, str) else " ".join(one),
)
def test_a_broken_file_is_one_plain_line(
    folder: Path, command: str, endings: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    monkeypatch.setattr("topdress.console.cli.screens.show_replay", lambda _: None)
    wrong = []
    for name in BROKEN:
        for one in endings:
            result = topdress(*COMMANDS[command](f"./{name}{one}"))
            said = [
                line
                for line in result.stderr.splitlines()
                if line.strip()
                and not line.startswith("note: ")
                # how to go on is a line of its own
                and not ("not imported:" in line or "not opened:" in line)
            ]
            trace = result.exit_code == 70 or (
                result.exception is not None and not isinstance(result.exception, SystemExit)
            )
            if command in READS_ANYTHING and result.exit_code == 0 and not trace and result.stdout:
                continue
            if command.startswith("import") and name == "wrong_columns" and not trace:
                # a table of something else: guessed, or each open question in a line
                continue
            # Each open question of a table is a line that begins with its file.
            asked = len(said) > 1 and all(
                line.startswith((f"./{name}{one}: ", f"{name}{one}: ")) for line in said
            )
            if (
                trace
                or result.exit_code == 0
                or not (len(said) == 1 or asked)
                or any(word in said[0] for word in WORDS_OF_A_BUG)
            ):
                wrong.append(
                    f"{name}{one}: exit {result.exit_code}: {said} {result.exception!r}"[:300]
                )
    assert wrong == []
    (folder / "out.import.yaml").unlink(missing_ok=True)  # what a guess is asked for
    assert sorted(folder.iterdir()) == before  # nothing half written


def test_a_log_that_stands_newest_first_is_imported_and_that_is_said(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(b"time_s,speed_mps\n5,3\n4,2\n3,1\n")
    done = topdress("import", tmp_path / "log.csv", "--out", tmp_path / "out.csv")
    assert (
        done.exit_code == 0
        and "note: " in done.stderr
        and "(2 of 3): taken in order of time" in done.stderr
    )
    assert (
        tmp_path / "out.csv"
    ).read_text() == "time_s,speed_mps\n0.000,1.0\n1.000,2.0\n2.000,3.0\n"


# --- Odd things that were given to the commands: one line each, and never a wait without an end
# ----------------------

ROWS = "time_s,speed_mps,shaft_rpm\n" + "".join(f"{k / 10},1.5,{40 + k % 5}\n" for k in range(60))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
@pytest.mark.parametrize(
    "command", [["map"], ["import", "--guess"], ["diagnose"]], ids=lambda one: one[0]
)
@pytest.mark.parametrize("name", ["pipe.csv", "pipe.geojson"])
def test_a_pipe_is_no_file(tmp_path: Path, command: list[str], name: str) -> None:
    os.mkfifo(tmp_path / name)
    done = topdress(*command, tmp_path / name)
    assert done.exit_code == 2 and "a pipe or a device: allowed is a file" in done.output, (
        done.output
    )


def test_the_same_file_twice_counts_once_or_not_at_all(tmp_path: Path) -> None:
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    log.write_text(ROWS)
    (tmp_path / "sub").mkdir()
    done = topdress("import", log, tmp_path / "sub" / ".." / "log.csv", "--out", out)
    assert done.exit_code == 2 and "named twice" in done.output and not out.exists()

"""The real program by its entry point, in a pseudo-terminal, with folders of its own."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from topdress.drivers.files.optional_packages import EXTRAS
from topdress.drivers.files.read_log import read_log

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")


@pytest.mark.parametrize("extras", ["with", "without"])
def test_a_morning_at_the_console(benchmark_module, tmp_path, monkeypatch, extras):
    """Starts, ready, start, numbers move, strategy, hold, stop, quit; then the log is opened.
    Without extras: console and worker have none of their packages."""
    if extras == "without":
        modules = sorted({module for _, of in EXTRAS.values() for module in of})
        (tmp_path / "sitecustomize.py").write_text(
            f"import sys\nsys.modules.update(dict.fromkeys({modules}))\n"
        )
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(tmp_path), str(ROOT))))
    deaths = benchmark_module("console_deaths")
    console = deaths.Console(tmp_path)
    wait, terminal = deaths.wait, console.terminal
    try:
        where = console.where()
        assert Path(where.log_path).is_relative_to(tmp_path), (
            "a developer's own runs are left alone"
        )
        watcher = deaths.Watcher(where)
        if extras == "without":
            wait(
                lambda: terminal.shows("The model check is off"),
                20.0,
                "what is not there",
                terminal,
            )
        wait(lambda: watcher.frames and terminal.shows("NDVI 0."), 20.0, "the Run screen", terminal)

        def row():
            return watcher.frames[-1][1].row

        def press(key, true, what):
            terminal.type(key)
            wait(true, 10.0, what, terminal)

        press("r", lambda: row().state == "ready" and terminal.shows("READY"), "ready")
        press("s", lambda: row().state == "working", "working")
        wait(lambda: (row().applied_rate_kg_ha or 0.0) > 100.0, 20.0, "material", terminal)
        wait(lambda: watcher.frames[-1][1].applied_kg > 0.05, 20.0, "kilograms", terminal)
        before = terminal.text()
        time.sleep(1.0)
        changed = sum(
            a != b for a, b in zip(before.split("\n"), terminal.text().split("\n"), strict=True)
        )
        assert changed >= 3, terminal.text()

        press("t", lambda: terminal.shows("Strategy"), "the question")
        terminal.type("2")
        press("\r", lambda: row().strategy == "speed_first", "speed first")
        press(" ", lambda: row().state == "held" and row().shaft_rpm_cmd == 0.0, "held")
        press("x", lambda: row().state == "off", "off")
        wait(lambda: terminal.shows("OFF"), 10.0, "off on the screen", terminal)
        terminal.type("\x11")
        wait(lambda: terminal.process.poll() is not None, 10.0, "the console's end", terminal)
        assert terminal.process.returncode == 0
        watcher.close()
    finally:
        terminal.end()
        console.end_worker()
    log = read_log(Path(where.log_path))
    rows = list(log.rows())
    states = [r.state for k, r in enumerate(rows) if k == 0 or rows[k - 1].state != r.state]
    assert states == ["off", "ready", "working", "held", "off"]
    orders = [
        event
        for r in rows
        if r.events
        for event in r.events.split(";")
        if event.split()[0] in ("ready", "start", "strategy", "hold", "stop")
    ]
    assert orders[:5] == ["ready", "start", "strategy speed_first", "hold", "stop"], orders
    assert set(orders[5:]) <= {"stop"}, "the worker stops once more as it ends"
    assert {r.strategy for r in rows} == {"opening_first", "speed_first"}
    assert max(r.applied_rate_kg_ha or 0.0 for r in rows) > 100.0
    assert rows[-1].shaft_rpm_cmd == 0.0
    assert not {a for r in rows for a in (r.alarms or "").split(";") if a}


GUIDE = ROOT / "docs" / "guides" / "first-day.md"
# as xterm sends them
TYPED = {"Space": " ", "Esc": "\x1b", "F3": "\x1bOR", "F10": "\x1b[21~"}


@pytest.mark.exam
def test_the_keys_of_the_operators_first_day(benchmark_module, tmp_path):
    """The first table of the guide: each key typed, and the screen says what the table says."""
    text = GUIDE.read_text(encoding="utf-8")
    table = text[text.index("| key |") :].split("\n\n")[0].splitlines()[2:]
    rows = [[cell.strip(" `") for cell in row.split("|")[1:4]] for row in table]
    assert len(rows) == 9
    deaths = benchmark_module("console_deaths")
    console = deaths.Console(tmp_path)
    terminal = console.terminal
    try:
        deaths.wait(lambda: terminal.shows("NDVI 0."), 20.0, "the Run screen", terminal)
        for key, _, words in rows:
            terminal.type(TYPED.get(key, key.lower()))
            deaths.wait(
                lambda words=words: terminal.shows(words), 10.0, f"{words} after {key}", terminal
            )
    finally:
        terminal.end()
        console.end_worker()


@pytest.mark.exam
def test_the_console_frozen_the_machine_is_held(benchmark_module, tmp_path):
    found = benchmark_module("console_deaths").console_dies(tmp_path, "SIGSTOP")
    assert found.ok, found


@pytest.mark.exam
def test_the_worker_killed_the_console_says_so(benchmark_module, tmp_path):
    found = benchmark_module("console_deaths").worker_dies(tmp_path)
    assert found.ok, found

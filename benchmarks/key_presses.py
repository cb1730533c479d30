"""Key presses of the commonest tasks, counted: `python -m benchmarks key_presses`

The real program in a pseudo-terminal, with its worker on the simulated machine. A task's keys go in one at a time;
after each it is looked whether the effect is there, in the worker's frames or its log. The count is of the keys that
were sent when it was. A key more than needed, or an effect that never comes, is a failure. POSIX only.
"""
from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from console_deaths import Console, Watcher, wait
from verdict import exit_code

from console.frame import Frame

ENTER, F3, F10, UNDO = "\r", "\x1bOR", "\x1b[21~", "\x1a"
RUN = "\x1bOQ"
NAMES = {ENTER: "Enter", F3: "F3", F10: "F10", UNDO: "Ctrl+Z", " ": "Space"}
BETWEEN_S = 1.0             # an Enter that follows another one sooner is taken for the same, held down
SETTLE_S = 2.0              # after the task before: its answer is on the screen
MOST_S = 30.0
MAP = Path(__file__).parents[1] / "configs" / "jobs" / "map_demo.geojson"


class Task(NamedTuple):
    """before: keys that set the scene, not counted. done: of the newest frame, the log's events since the first of the
    counted keys, and the screen. most: presses that it may take."""

    name: str
    keys: str | tuple[str, ...]
    done: Callable[[Frame, str, str], bool]
    most: int
    before: tuple[str, ...] = ()


def state(word: str) -> Callable[[Frame, str, str], bool]:
    return lambda frame, _events, _screen: frame.row.state == word


def event(word: str) -> Callable[[Frame, str, str], bool]:
    return lambda _frame, events, _screen: word in events


TASKS = (
    Task("ready and start", "rs", state("working"), 2),
    Task("hold", " ", state("held"), 1),
    Task("go on", "s", state("working"), 1),
    Task("strategy", ("t", "2", ENTER), lambda frame, _e, _s: frame.row.strategy == "speed_first", 3),
    Task("the last change taken back", (UNDO, ENTER), lambda frame, _e, _s: frame.row.strategy == "opening_first", 2),
    Task("nudge", ("+", ENTER), lambda frame, _e, _s: frame.row.nudge_percent == 5.0, 2),
    Task("manual rate, typed", ("m", "1", "8", "0", ENTER, ENTER),
         lambda frame, _e, _s: frame.row.target_source == "manual", 6),
    Task("canopy again", ("o", "1", ENTER), lambda frame, _e, _s: frame.row.target_source == "canopy", 3),
    Task("manual rate, a preset", (".", ENTER), event("manual_rate"), 2),
    Task("refill, typed", ("f", "2", "5", "0", ENTER), event("refill 250"), 5),
    Task("refill, hopper full", ("f", "f", ENTER), event("refill"), 3),
    Task("refill taken back", (UNDO, ENTER), event("refill_back"), 2),
    Task("A-B line", (F3, "n"), lambda _f, _e, screen: "A is here" in screen, 2, (RUN,)),
    Task("STOP", "x", state("off"), 1),
    Task("map taken", (F10, "p", ENTER, ENTER, ENTER),
         lambda _f, _e, screen: "map_demo" in screen.splitlines()[0] or "control worker started" in screen, 6, (RUN,)),
)


def counted(task: Task, console: Console) -> int:
    """Keys that were sent when the effect was there. Raises TimeoutError where it does not come."""
    terminal, where = console.terminal, console.where()
    watcher = Watcher(where)
    try:
        wait(lambda: bool(watcher.frames), 20.0, "frames", terminal)
        time.sleep(SETTLE_S)
        for key in task.before:
            terminal.type(key)
            time.sleep(BETWEEN_S)
        log = Path(where.log_path)
        begins = log.stat().st_size

        def there() -> bool:
            with log.open("rb") as file:
                file.seek(begins)
                events = file.read().decode(errors="replace")
            return task.done(watcher.frames[-1][1], events, terminal.text()) or console.where().log_path != str(log)

        for sent, key in enumerate(task.keys, 1):
            terminal.type(key)
            until_s = time.monotonic() + (MOST_S if sent == len(task.keys) else BETWEEN_S)
            while time.monotonic() < until_s:
                if there():
                    return sent
                time.sleep(0.05)
        raise TimeoutError(f"{task.name}: no effect after {len(task.keys)} keys\n{terminal.text()}")
    finally:
        watcher.close()


def run() -> int:
    promises: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as place:
        downloads = Path(place) / "home" / "Downloads"
        downloads.mkdir(parents=True)
        shutil.copy(MAP, downloads)
        console = Console(Path(place))
        try:
            wait(lambda: console.terminal.shows("NDVI 0."), 60.0, "numbers", console.terminal)
            for task in TASKS:
                try:
                    presses = counted(task, console)
                except TimeoutError as error:
                    print(error)
                    promises[f"{task.name}: done"] = False
                    console.terminal.type("\x1b")
                    continue
                keys = " ".join(NAMES.get(key, key.upper()) for key in task.keys[:presses])
                print(f"{task.name:28} {presses}   {keys}", flush=True)
                promises[f"{task.name}: {presses} presses: at most {task.most}"] = presses <= task.most
        finally:
            console.terminal.end()
            console.end_worker()
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(run())

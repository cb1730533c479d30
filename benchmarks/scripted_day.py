"""A day at the console, key by key, in a pseudo-terminal: `python benchmarks/scripted_day.py --out day/`

The real program through all its drivers on `topdress serve-machine`, in real time, some eight minutes. The hopper is
nearly empty, so that it must be refilled; the shaft turns 6 % slower than it should, which can be diagnosed; the
receiver is unplugged for a while. Writes `keys.log` (time, keys,
what was waited for) and the screens as they stood, as text. POSIX only.
"""
from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import yaml
from console_deaths import SIZE, Console, Terminal, Watcher, wait
from verdict import exit_code

from console.frame import Frame
from drivers.files.read_log import read_log

HIDDEN = "shaft.gain=-6"
PORT = 4300
UNPLUGGED_S, FOR_S = 75.0, 8.0          # the receiver, since the machine was switched on
KEYS = {"F2": "\x1bOQ", "F3": "\x1bOR", "F5": "\x1b[15~", "F7": "\x1b[18~", "F9": "\x1b[20~", "F10": "\x1b[21~",
        "Enter": "\r", "Space": " ", "Down": "\x1b[B", "Ctrl+Q": "\x11", "Esc": "\x1b"}


STANDS_S = 120.0              # work that says nothing new for so long has come to a stop


class DayConsole(Console):
    """A machine of its own behind TCP: its hopper will be empty soon, and it is not what its file says."""

    machine: subprocess.Popen[bytes] | None = None

    def open(self) -> Terminal:
        program = str(Path(sys.executable).parent / "topdress")
        cab = self.folder / "cab.yaml"
        if self.machine is None:
            job = yaml.safe_load(self.job.read_text(encoding="utf-8"))
            job["simulated"] |= {"hopper_kg": 31.0, "refill_at_kg": 22.0, "refill_stop_s": 15.0}
            self.job.write_text(yaml.safe_dump(job), encoding="utf-8")
            shipped = (Path(__file__).parents[1] / "configs" / "cabs" / "virtual.yaml").read_text(encoding="utf-8")
            cab.write_text(shipped.replace("127.0.0.1:41", f"127.0.0.1:{PORT // 100}"), encoding="utf-8")
            self.machine = subprocess.Popen(
                [program, "serve-machine", "--port", str(PORT), "--job", str(self.job), "--effect", HIDDEN,
                 "--fault", f"unplug:gnss@{UNPLUGGED_S:g}+{FOR_S:g}"], env=self.environment, stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL)
        return Terminal([program, "run", "--config", str(self.job), "--config", str(cab)], self.environment)

    def end_worker(self) -> None:
        super().end_worker()
        if self.machine is not None:
            self.machine.terminate()
            self.machine.wait()


class Day:
    def __init__(self, folder: Path, out: Path, caps_lock: bool = False) -> None:
        out.mkdir(parents=True, exist_ok=True)
        self.out, self.console, self.caps_lock = out, DayConsole(folder), caps_lock
        self.begun_s = time.monotonic()
        self.lines: list[str] = []
        self.pictures = 0
        self.watcher: Watcher | None = None
        self.first_log = ""

    @property
    def frame(self) -> Frame:
        assert self.watcher is not None
        return self.watcher.frames[-1][1]

    def say(self, text: str) -> None:
        self.lines.append(f"{time.monotonic() - self.begun_s:7.1f} s  {text}")
        print(self.lines[-1], flush=True)
        (self.out / "keys.log").write_text("\n".join(self.lines) + "\n", encoding="utf-8")

    def press(self, *keys: str) -> None:
        for key in keys:
            self.console.terminal.type(KEYS.get(key, key.upper() if self.caps_lock else key))
            time.sleep(0.25)
        self.say("press  " + " ".join(key if key in KEYS or not self.caps_lock else key.upper() for key in keys))

    def answer(self, question: str, *keys: str) -> None:
        """Keys for a dialog, once it stands there."""
        wait(lambda: self.console.terminal.shows(question), 20.0, question, self.console.terminal)
        time.sleep(0.3)
        self.press(*keys)

    def until(self, what: str, true: Callable[[], bool], most_s: float = 30.0) -> None:
        took_s = wait(true, most_s, what, self.console.terminal)
        self.say(f"       {what}: after {took_s:.1f} s")

    def shows(self, words: str, most_s: float = 30.0) -> None:
        self.until(f"the screen says {words!r}", lambda: self.console.terminal.shows(words), most_s)

    def goes_on_until(self, words: str, at_work: str) -> None:
        """However long it takes on a busy machine: given up where the lines that tell of the work stand still."""
        told, moved_s, begun_s = "", time.monotonic(), time.monotonic()
        while not self.console.terminal.shows(words):
            lines = "".join(row for row in self.console.terminal.text().splitlines() if at_work in row or "░" in row)
            if lines != told:
                told, moved_s = lines, time.monotonic()
            elif time.monotonic() - moved_s > STANDS_S:
                raise TimeoutError(f"{words!r}: no progress for {STANDS_S:g} s")
            time.sleep(0.2)
        self.say(f"       the screen says {words!r}: after {time.monotonic() - begun_s:.1f} s")

    def picture(self, name: str) -> None:
        time.sleep(1.3)                       # plots are drawn twice a second, maps once
        self.pictures += 1
        (self.out / f"{self.pictures:02d}-{name}.txt").write_text(self.console.terminal.text() + "\n", encoding="utf-8")

    def watch(self) -> None:
        self.watcher = Watcher(self.console.where())
        wait(lambda: bool(self.watcher and self.watcher.frames), 20.0, "frames", self.console.terminal)

    def state(self, name: str, most_s: float = 15.0) -> None:
        self.until(f"state {name}", lambda: self.frame.row.state == name, most_s)

    # --- the day ----------------------------------------------------------------------------------------------------

    def morning(self) -> None:
        self.watch()
        self.first_log = Path(self.console.where().log_path).name
        self.shows("NDVI 0.", 30.0)
        self.picture("start")
        self.press("F10")
        self.shows("before work")
        self.picture("job-before-work")
        self.press("F2", "r")
        self.state("ready")
        self.press("s")
        self.state("working")
        self.until("fertilizer flows", lambda: (self.frame.row.applied_rate_kg_ha or 0.0) > 100.0)
        time.sleep(15.0)
        self.picture("work")

    def strategy(self) -> None:
        self.press("t")
        self.answer("Strategy", "2", "Enter")
        self.until("speed first", lambda: self.frame.row.strategy == "speed_first")
        time.sleep(20.0)
        self.press("F3")
        self.picture("map-speed-first")
        self.press("F2", "t")
        self.answer("Strategy", "1", "Enter")
        self.until("opening first", lambda: self.frame.row.strategy == "opening_first")

    def sensor_loss(self) -> None:
        """The receiver is unplugged; work goes on by the wheel. Disconnecting by key is refused while working."""
        self.press("F5", "c")
        self.answer("Disconnect", "Enter")
        self.shows("refused", 10.0)
        self.until("an alarm for the receiver", lambda: any("gnss" in a.id for a in self.frame.alarms),
                   90.0)
        self.picture("receiver-gone")
        self.until("no such alarm", lambda: not any("gnss" in a.id for a in self.frame.alarms))
        self.press("a", "F2")

    def refill(self) -> None:
        self.until("the hopper is low and the machine stands", lambda: (self.frame.row.speed_used_mps or 0.0) < 0.05,
                   240.0)
        self.picture("hopper-low")
        if self.frame.row.state == "working":
            self.press("Space")
            self.state("held")
        full_kg = self.frame.row.hopper_kg or 0.0
        self.until("the hopper is filled", lambda: (self.frame.row.hopper_kg or 0.0) > full_kg + 50.0, 60.0)
        self.press("F10")
        self.shows("the scale saw", 40.0)
        self.picture("refill-seen")
        self.press("f")
        self.answer("Enter records it", "Enter")
        self.until("the refill is recorded", lambda: bool(self.frame.tally and self.frame.tally.refills))
        self.press("a", "F2", "s")
        self.state("working")
        time.sleep(60.0)

    def power_cut(self) -> None:
        area_ha, where = self.frame.area_ha, self.console.where()
        self.say(f"       kill -9 of worker and console at {area_ha:.3f} ha, {self.frame.applied_kg:.2f} kg")
        os.kill(where.pid, signal.SIGKILL)
        os.kill(self.console.terminal.process.pid, signal.SIGKILL)
        self.console.terminal.end()
        rows = list(read_log(Path(where.log_path)).rows())
        self.say(f"       the log is whole: {len(rows)} rows, last state {rows[-1].state}")
        self.console.terminal = self.console.open()
        self.shows("resume the job")
        self.picture("resume")
        self.press("Enter")
        self.watch()
        self.until("the area done is there again", lambda: abs(self.frame.area_ha - area_ha) < 0.005)
        self.say(f"       {self.frame.area_ha:.3f} ha, {self.frame.applied_kg:.2f} kg, state {self.frame.row.state}")
        self.press("r")
        self.state("ready")
        self.press("s")
        self.state("working")
        time.sleep(45.0)
        self.picture("resumed")

    def evening(self) -> None:
        self.press("x")
        self.state("off")
        self.press("F10", "k")
        self.answer("End this job?", "Enter")
        self.shows(".html", 60.0)
        self.picture("end-of-job")
        self.press("F7", "o")
        self.answer("Open a log", "Enter")
        self.shows("as recorded", 60.0)
        self.press("p", ".", ".", ".")
        time.sleep(5.0)
        self.picture("replay")
        self.press("p")

    def learn(self) -> None:
        """The log of the morning."""
        self.press("F9")
        self.shows("run", 20.0)
        time.sleep(2.0)
        for _row in range(12):                # exports of the evening stand above the log of the morning
            if any(row.lstrip().startswith(">") and f" {self.first_log}" in row
                   for row in self.console.terminal.text().splitlines()):
                break
            self.press("Down")
        self.press("Enter")
        self.goes_on_until("against huanghai", "Esc cancels")
        self.picture("diagnosis")
        self.press("k")
        self.shows("machine file")
        self.picture("adopt-asked")
        self.press("Enter")
        time.sleep(1.0)
        if self.console.terminal.shows("Why this one?"):
            self.answer("Why this one?", *"tried", "Enter")
        self.shows(".yaml", 20.0)
        self.picture("adopted")
        self.press("Enter")
        self.answer("Use it now?", "Esc")
        self.press("Ctrl+Q")
        self.until("the console's end", lambda: self.console.terminal.process.poll() is not None)

    def run(self) -> int:
        try:
            for part in (self.morning, self.strategy, self.sensor_loss, self.refill, self.power_cut, self.evening,
                         self.learn):
                self.say(f"-- {part.__name__}")
                part()
            done = {f"{self.frame.applied_kg:.2f} kg spread: above 0": self.frame.applied_kg > 0.0}
            self.say(f"-- done, terminal {SIZE[0]} x {SIZE[1]}, {self.pictures} screens")
            return exit_code(done)
        except TimeoutError as error:
            self.picture("stuck")
            self.say(f"STUCK: {str(error).splitlines()[0]}")
            return exit_code({"the day's end was reached": False})
        finally:
            self.console.terminal.end()
            self.console.end_worker()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--caps-lock", action="store_true", help="Every letter comes as a capital.")
    with tempfile.TemporaryDirectory() as own:
        given = parser.parse_args()
        sys.exit(Day(Path(own), given.out, given.caps_lock).run())

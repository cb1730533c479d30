"""The slave board's own program: how soon it stops when its host is killed, and pulses against commanded angle.

    python -m benchmarks slave_program --kills 10

First the scenarios of the tests with a small machine behind the pins, under CPython and, where Node and MicroPython's
WebAssembly build are there (`--micropython FOLDER`, the folder of micropython.mjs), under MicroPython. Then (POSIX) the
program on a pseudo-terminal in real time: the real host driver in a process of its own makes it ready, turns the
shaft and is killed (SIGKILL); then doses of several angles by the real driver, steps put out counted.
"""
from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from verdict import exit_code

from control.readings import DriveCommand
from drivers.board.slave import Pins, Settings, Slave
from drivers.cab import Cab, CabConfig
from drivers.devices.point_dose import DoseState

ROOT = Path(__file__).parents[1]
OFF_S = 1.3                     # the board's own 1 s after its last frame, and a thread's turn
SCENARIOS = ROOT / "tests" / "board" / "board_scenarios.py"
BOARD_FILES = ("__init__.py", "framing.py", "motion.py", "parts.py", "slave.py", "lag_rig.py")
PRINTED = ("safe_stop", "stop_at_once", "shaft_step", "shaft_step_after_jam", "shaft_step_after_hand",
        "shaft_step_weak_supply", "gate_step", "gate_moves", "doses", "lost_steps")
RUNNER = """
const { readFileSync } = await import('node:fs');
const [folder, ...files] = process.argv.slice(2);
const { loadMicroPython } = await import(folder + '/micropython.mjs');
const mp = await loadMicroPython({ stdout: (line) => process.stdout.write(line + '\\n'), linebuffer: true,
                                   heapsize: 16 * 1024 * 1024 });
for (const name of ['/app', '/app/drivers', '/app/drivers/board']) mp.FS.mkdir(name);
mp.FS.writeFile('/app/drivers/__init__.py', '');
for (const file of files) {
  const name = file.split('/').pop();
  mp.FS.writeFile((file.includes('/drivers/board/') ? '/app/drivers/board/' : '/app/') + name, readFileSync(file));
}
mp.runPython("import sys; sys.path.append('/app')\\nimport board_scenarios; board_scenarios.main()");
"""
HOST = """
import sys, time
from control.readings import DriveCommand
from drivers.cab import Cab, CabConfig
cab = Cab(CabConfig.model_validate({"board": {"port": sys.argv[1]}}), time.monotonic)
started_s = time.monotonic()
while True:
    now_s = time.monotonic()
    cab.measure(now_s)
    cab.command(now_s, DriveCommand(60.0, 30.0), now_s - started_s > 0.5)
    time.sleep(0.05)
"""


class TerminalPins(Pins):
    """A motor of 0.1 s, a gate that follows its steps, and counters, behind a pseudo-terminal."""

    def __init__(self) -> None:
        import tty
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.name = os.ttyname(self.slave)
        self.off_at_s = 0.0
        self.on = False
        self.rpm = self.turns = self._duty = 0.0
        self.mm = 25.0
        self.doses = 0

    def pass_time(self, dt_s: float) -> None:
        self.rpm += ((self._duty * 125.0 if self.on else 0.0) - self.rpm) * dt_s / 0.1
        self.turns += self.rpm / 60.0 * dt_s

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            return os.read(self.master, 4096)
        return b""

    def write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self.master, data)

    def enable(self, on: bool) -> None:
        if self.on and not on:
            self.off_at_s = time.monotonic()
        self.on = on

    def duty(self, value: float) -> None:
        self._duty = value

    def shaft_counts(self) -> int:
        return int(self.turns * Settings.counts_per_turn)

    def gate_steps(self, steps: int) -> None:
        self.mm += steps / Settings.steps_per_mm

    def dose_steps(self, steps: int) -> None:
        self.doses += steps

    def opening_mm(self) -> float:
        return self.mm


@contextlib.contextmanager
def board() -> TerminalPins:            # type: ignore[misc]
    """The program running in real time on a thread of its own."""
    pins = TerminalPins()
    program = Slave(pins, Settings())
    stop = threading.Event()

    def run() -> None:
        started_s, passed_us = time.monotonic(), 0
        while not stop.is_set():
            now_us = int((time.monotonic() - started_s) * 1e6)
            while passed_us + 1000 <= now_us:
                pins.pass_time(0.001)
                passed_us += 1000
                program.tick(passed_us)
            time.sleep(0.001)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield pins
    finally:
        stop.set()
        thread.join()
        os.close(pins.master)
        os.close(pins.slave)


def until(what: object, seconds: float = 10.0) -> None:
    end_s = time.monotonic() + seconds
    while not what():                   # type: ignore[operator]
        if time.monotonic() > end_s:
            sys.exit("waited in vain")
        time.sleep(0.002)


def kill() -> float:
    """Seconds from the host's death to the motor's enable line."""
    with board() as pins:
        host = subprocess.Popen([sys.executable, "-c", HOST, pins.name])
        try:
            until(lambda: pins.on and abs(pins.rpm - 60.0) < 2.0)
            time.sleep(0.5)
            os.kill(host.pid, signal.SIGKILL)
            killed_s = time.monotonic()
            until(lambda: not pins.on, 5.0)
            return float(pins.off_at_s - killed_s)
        finally:
            host.kill()
            host.wait()


def doses() -> dict[str, object]:
    """Steps put out for doses of several angles, by the real driver over the terminal."""
    print("\n| angle, degrees | doses | steps put out | angle x 400 / 360 x doses | reported as turned, degrees |")
    print("|---|---|---|---|---|")
    promises: dict[str, object] = {}
    with board() as pins:
        cab = Cab(CabConfig.model_validate({"board": {"port": pins.name}}), time.monotonic)
        started_s = time.monotonic()

        def tick() -> None:
            now_s = time.monotonic()
            cab.measure(now_s)
            cab.command(now_s, DriveCommand(0.0, 25.0), now_s - started_s > 0.4)
            time.sleep(0.02)

        while time.monotonic() - started_s < 1.0:
            tick()
        for angle_deg in (30.0, 45.5, 120.0, 360.0):
            before, reported = pins.doses, 0.0
            for _ in range(20):
                cab.give_dose(time.monotonic(), angle_deg, 99.8)
                until_s = time.monotonic() + 5.0
                while cab.dose is None or cab.dose.state in (DoseState.SENT, DoseState.RUNNING):
                    if time.monotonic() > until_s:
                        sys.exit(f"a dose of {angle_deg:g} degrees: no end of it was reported")
                    tick()
                reported += cab.dose.turned_deg or 0.0
            print(f"| {angle_deg:g} | 20 | {pins.doses - before} | {20 * angle_deg * 400 / 360:.1f} | {reported:.1f} |")
            promises[f"20 doses of {angle_deg:g} degrees: as many steps as they ask for, a step each at most"] = (
                abs(pins.doses - before - 20 * angle_deg * 400 / 360) <= 20.0)
        cab.close()
    return promises


def under_micropython(folder: Path) -> dict[str, object]:
    with tempfile.TemporaryDirectory() as place:
        script = Path(place) / "run.mjs"
        script.write_text(RUNNER)
        files = [ROOT / "drivers" / "board" / name for name in BOARD_FILES]
        done = subprocess.run(["node", str(script), str(folder), *map(str, files), str(SCENARIOS)],
                              capture_output=True, text=True, timeout=300, check=True)
    return dict(json.loads(line) for line in done.stdout.splitlines())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--micropython", type=Path, help="folder of micropython.mjs")
    given = parser.parse_args()
    code = f"import runpy; runpy.run_path({str(SCENARIOS)!r})['main']()"
    here = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT,
                          env=os.environ | {"PYTHONPATH": str(ROOT)})
    plain = dict(json.loads(line) for line in here.stdout.splitlines())
    promises: dict[str, object] = {"scenarios were played": plain}
    for name in PRINTED:
        print(f"{name:24} {json.dumps(plain[name])}")
    if given.micropython:
        micro = under_micropython(given.micropython)
        same = [name for name in plain if micro[name] == plain[name]]
        print(f"MicroPython: {len(same)} of {len(plain)} scenarios give the same numbers")
        promises["every scenario gives the same numbers under MicroPython"] = len(same) == len(plain)
    if sys.platform == "win32":
        return exit_code(promises)
    if given.kills < 1:
        return exit_code(promises | {"the host was killed at least once": False})
    took_s = sorted(kill() for _ in range(given.kills))
    print(f"\nhost killed {given.kills} times: motors off after {took_s[0]:.3f} to {took_s[-1]:.3f} s, median "
          f"{took_s[len(took_s) // 2]:.3f} s")
    promises[f"motors off {took_s[-1]:.2f} s after the host's death: at most {OFF_S:g} s"] = took_s[-1] <= OFF_S
    return exit_code(promises | doses())


if __name__ == "__main__":
    sys.exit(main())

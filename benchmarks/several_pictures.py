"""Two consoles and two tablets at one machine, what each of them saw: `python -m benchmarks several_pictures FOLDER`.

Starts a simulated machine with two consoles in a tmux of its own and two tabs of a headless Chromium, orders from
three of them, ends one console, then the other. After each step the consoles' screens (.txt) and the tabs' (.png) are
written, and at the end who came, went and ordered as the run log has it. Needs tmux and chromium on the path, Linux.
"""
from __future__ import annotations

import argparse
import asyncio
import csv
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import aiohttp
from tablet_pictures import SETTLE_S, browser, opened
from verdict import exit_code

CONSOLES, TABLETS = ("ann@cab", "lab@desk"), ("tablet Ann", "tablet office")
WHO = ("attached", "left", "silent", "heard")
TOPDRESS = (sys.executable, "-c", "from console.cli import main; main()")
KEY = "twobytwo"
WAIT_S = 90.0


class Scene:
    """Programs with folders of their own; `folder` gets what they show."""

    def __init__(self, folder: Path, home: Path) -> None:
        self.folder, self.home = folder, home
        own = ("XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME")
        self._env = os.environ | dict.fromkeys(own, str(home))
        (home / "topdress").mkdir()
        (home / "topdress" / "seen").touch()                   # no tour
        self._tmux = ("tmux", "-S", str(home / "tmux"))
        self._serve: subprocess.Popen[bytes] | None = None
        self.log = home / "run.csv"

    def console(self, name: str) -> None:
        command = [*TOPDRESS, "run", "--name", name, "--log", str(self.log),
                   "--no-model-check"]
        subprocess.run([*self._tmux, "new-session", "-d", "-s", name, "-x", "120", "-y", "36", *command],
                       env=self._env, check=True)

    def keys(self, name: str, *keys: str) -> None:
        for key in keys:
            subprocess.run([*self._tmux, "send-keys", "-t", name, key], check=True)
            time.sleep(0.6)

    def screen(self, name: str) -> str:
        return subprocess.run([*self._tmux, "capture-pane", "-p", "-t", name], capture_output=True, text=True,
                              check=False).stdout

    def until(self, name: str, text: str) -> None:
        end_s = time.monotonic() + WAIT_S
        while text not in self.screen(name):
            if time.monotonic() > end_s:
                sys.exit(f"{name} does not show {text!r}:\n{self.screen(name)}")
            time.sleep(0.2)

    def serve(self) -> str:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        key = self.home / "tablet.key"
        key.write_text(KEY + "\n", encoding="utf-8")
        command = [*TOPDRESS, "serve", "--port", str(port), "--token-file", str(key)]
        self._serve = subprocess.Popen(command, env=self._env, stdout=subprocess.DEVNULL)
        return f"http://127.0.0.1:{port}/?fontsize=15"

    def close(self) -> None:
        if self._serve is not None:
            self._serve.terminate()
            self._serve.wait()
        subprocess.run([*self._tmux, "kill-server"], check=False, capture_output=True)
        run_file = next(self.home.rglob("worker.json"), None)
        if run_file is not None:
            os.kill(json.loads(run_file.read_text(encoding="utf-8"))["pid"], 15)

    def events(self) -> list[str]:
        with open(self.log, encoding="utf-8") as file:
            return [f"{float(row['time_s']):7.2f} s  {row['state']:8} {event}" for row in csv.DictReader(file)
                    for event in (row["events"] or "").split(";")
                    if event.partition(" ")[0] in WHO or event.partition(" ")[0].endswith("_by")]


async def play(scene: Scene, port: int) -> None:
    """The steps; after each everybody's screen."""
    first, second = CONSOLES
    scene.console(first)
    scene.until(first, "OFF")
    time.sleep(2.0)
    scene.keys(first, "Escape", "r", "s")                     # Escape: the question which job
    scene.until(first, "WORKING")
    scene.console(second)
    scene.until(second, "joined it")
    async with aiohttp.ClientSession() as session:
        address = scene.serve()
        await asyncio.sleep(5.0)
        tabs = {name: await opened(session, port, f"{address}&name={name.replace(' ', '%20')}", 1100, 700)
                for name in TABLETS}

        async def shown(step: str, consoles: tuple[str, ...] = CONSOLES) -> None:
            await asyncio.sleep(2.0)
            for name in consoles:
                (scene.folder / f"{step}-{name}.txt").write_text(scene.screen(name), encoding="utf-8")
            for name, tab in tabs.items():
                await tab.shoot(scene.folder / f"{step}-{name.replace(' ', '-')}.png")

        async def step(name: str, do: Callable[[], Awaitable[None] | None],
                       consoles: tuple[str, ...] = CONSOLES) -> None:
            waited = do()
            if waited is not None:
                await waited
            await shown(name, consoles)

        async def operate() -> None:
            await tabs[TABLETS[0]].press("*")
            await asyncio.sleep(SETTLE_S)                      # the dialog is there to be typed into
            for key in (*KEY, "Enter"):
                await tabs[TABLETS[0]].press(key)
                await asyncio.sleep(0.3)
            await asyncio.sleep(SETTLE_S)

        async def nudge() -> None:
            for key in ("+", "Enter"):
                await tabs[TABLETS[0]].press(key)
                await asyncio.sleep(1.0)

        await asyncio.sleep(SETTLE_S)
        await shown("1-joined")
        scene.keys(second, "Escape")
        await step("2-tablet-operates", operate)
        await step("3-tablet-nudges", nudge)
        await step("4-second-console-holds", lambda: scene.keys(second, "Space"))
        await step("5-first-console-starts", lambda: scene.keys(first, "s"))
        await step("6-first-console-leaves", lambda: scene.keys(first, "C-q"))
        await step("7-first-console-left", lambda: scene.keys(first, "Enter"), (second,))
        await step("8-second-console-leaves", lambda: scene.keys(second, "C-q"), (second,))
        scene.keys(second, "Enter")
        await asyncio.sleep(3.0)
        await shown("9-no-console-is-left", ())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    if shutil.which("tmux") is None:
        sys.exit("no tmux is installed: no pictures")
    given.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="several-") as home, browser() as port:
        scene = Scene(given.folder, Path(home))
        try:
            asyncio.run(play(scene, port))
        finally:
            scene.close()
        time.sleep(2.0)
        events = scene.events()
    print("\n".join(events))
    said = "\n".join(events)
    wanted = (*(f"attached {name}" for name in (*CONSOLES, *TABLETS)), "start_by ann@cab", "nudge_by tablet Ann",
              "hold_by lab@desk", "left ann@cab", "left lab@desk")
    return exit_code({f"the log has: {one}": one in said for one in wanted})


if __name__ == "__main__":
    sys.exit(main())

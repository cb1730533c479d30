"""Pictures of the console in a real browser: `python -m benchmarks tablet_pictures http://127.0.0.1:8000 FOLDER`.

Drives a headless Chromium over its DevTools protocol: two tabs at once, landscape and portrait, then each page given
with --keys. Needs `topdress serve` at the address, and chromium on the path.
"""
from __future__ import annotations

import argparse
import asyncio
import base64
import itertools
import json
import shutil
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

import aiohttp
from verdict import exit_code

SIZES = {"landscape": (1280, 800), "portrait": (800, 1280)}
SETTLE_S = 4.0
BLANK_BYTES = 20_000            # an empty page takes a third of it
OPEN_S = 60.0
KEY_CODES = {"Enter": 13, "Escape": 27} | {f"F{n}": 111 + n for n in range(1, 13)}
SIGN_CODES = {",": 188, "-": 189, ".": 190, "/": 191, "[": 219, "]": 221}     # their letters' codes are other keys


class Tab:
    """One tab of the browser, by its own socket."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._numbers = itertools.count(1)
        self.sizes: dict[Path, int] = {}                # of the pictures, bytes

    async def ask(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._numbers)
        await self._socket.send_json({"id": number, "method": method, "params": params})
        async for message in self._socket:
            said = json.loads(message.data)
            if said.get("id") == number:
                if "error" in said:
                    raise RuntimeError(f"{method}: {said['error']['message']}")
                return dict(said["result"])
        raise RuntimeError(f"{method}: the browser has gone")

    async def open(self) -> None:
        """Waits until the console in the tab has started to draw."""
        started = "document.body.classList.contains('-first-byte')"
        for _try in range(int(OPEN_S / 0.2)):
            said = await self.ask("Runtime.evaluate", expression=started, returnByValue=True)
            if said["result"].get("value"):
                return
            await asyncio.sleep(0.2)
        raise RuntimeError("the console did not open in the tab")

    async def size(self, width: int, height: int) -> None:
        await self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
                       mobile=False)

    async def press(self, key: str) -> None:
        """A key by its DOM name, Space, or a single character."""
        key = " " if key == "Space" else key
        code = (KEY_CODES | SIGN_CODES).get(key, ord(key[-1].upper()))
        text = {} if key in KEY_CODES and key != "Enter" else {"text": "\r" if key == "Enter" else key}
        await self.ask("Input.dispatchKeyEvent", type="keyDown", key=key, windowsVirtualKeyCode=code, **text)
        await self.ask("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=code)

    async def shoot(self, path: Path) -> None:
        said = await self.ask("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(said["data"]))
        self.sizes[path] = path.stat().st_size
        print(path)


async def opened(session: aiohttp.ClientSession, port: int, address: str, width: int, height: int) -> Tab:
    """A new tab of the browser with a console that draws."""
    request = urllib.request.Request(f"http://127.0.0.1:{port}/json/new?{quote(address, safe='')}", method="PUT")
    with urllib.request.urlopen(request) as answer:
        target = json.load(answer)
    tab = Tab(await session.ws_connect(target["webSocketDebuggerUrl"], max_msg_size=0))
    await tab.size(width, height)
    await tab.open()
    await tab.size(width, height)                   # again: now that the terminal is there to be fitted
    return tab


async def pictures(address: str, folder: Path, keys: list[str], port: int) -> dict[Path, int]:
    async with aiohttp.ClientSession() as session:
        tabs = {name: await opened(session, port, address, *size) for name, size in SIZES.items()}
        await asyncio.sleep(SETTLE_S)
        for name, tab in tabs.items():
            await tab.shoot(folder / f"tablet-{name}.png")
        for number, press in enumerate(keys, 1):
            for tab in tabs.values():
                for key in press.split("+"):
                    await tab.press(key)
            await asyncio.sleep(SETTLE_S)
            for name, tab in tabs.items():
                await tab.shoot(folder / f"tablet-{name}-{number}.png")
        return {path: size for tab in tabs.values() for path, size in tab.sizes.items()}


@contextmanager
def browser() -> Iterator[int]:
    """A headless Chromium with a profile of its own: the port on which it is steered."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        sys.exit("no chromium is installed: no pictures")
    with tempfile.TemporaryDirectory(prefix="tabs-") as profile:
        child = subprocess.Popen([program, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                                  "--remote-debugging-port=0", f"--user-data-dir={profile}", "about:blank"],
                                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield _port(Path(profile))
        finally:
            child.terminate()
            child.wait()


def _port(profile: Path) -> int:
    """The port that the browser chose; it writes it into its profile."""
    port_file = profile / "DevToolsActivePort"
    for _try in range(200):
        if port_file.exists() and (lines := port_file.read_text().split()):
            return int(lines[0])
        subprocess.run(["sleep", "0.1"], check=True)
    sys.exit("the browser does not answer")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("address")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--keys", nargs="*", default=[], help="after the first pictures: keys to press in both tabs, "
                        "joined by +, e.g. F3 or *; a picture of both after each")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    with browser() as port:
        sizes = asyncio.run(pictures(given.address, given.folder, given.keys, port))
    return exit_code({f"{path}: {size} bytes: a console is drawn, at least {BLANK_BYTES}": size >= BLANK_BYTES
                      for path, size in sizes.items()})


if __name__ == "__main__":
    sys.exit(main())

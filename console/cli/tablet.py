"""One tab of `topdress serve`, started by the server:
`python -m topdress.console.cli.tablet [--token-file F]`."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import ipaddress
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from topdress.console.app.services import Services
from topdress.console.app.tablet import NONE_RUNS, Key, TabletApp
from topdress.console.link import Link
from topdress.console.locale import _
from topdress.console.running import WorkerAddress, WorkerFailed, default_run_file, find_running
from topdress.console.serve import ADDRESS, SERVER
from topdress.console.worker.system import private_folder, write_private
from topdress.drivers.files.lock import take_lock

# of addresses; a tab with a long log open has some 2 GB of them, and uses a tenth
TAB_BYTES = 4 << 30
TAB_NICE = 10
# of which wrong keys are counted: more than a cab's network has
MOST_ADDRESSES, MOST_BYTES = 100, 20_000
# how often a tab looks whether its server still runs
PARENT_S = 0.5


class TabLink(Link):
    """A tab never keeps the machine working: that is the part of the console on the machine.
    When that is gone, the worker holds, whatever a tablet that may have fallen asleep still has
    open."""

    keeps_alive = False
    tablet = True


async def link_to(operating: bool, find: Callable[[], WorkerAddress | None] = find_running) -> Link:
    """To the worker that runs; without its token unless the tab operates. Raises WorkerFailed."""
    where = await asyncio.to_thread(find)
    if where is None:
        raise WorkerFailed(_(NONE_RUNS))
    return TabLink(where if operating else where.looking_only())


def read_token(path: Path | None) -> str | None:
    """The first line of the token file; None where there is no such file or it is empty."""
    if path is None:
        return None
    try:
        lines = path.read_text(encoding="utf-8").strip().splitlines()
    except OSError:
        return None
    return lines[0].strip() if lines and lines[0].strip() else None


def read_options(where: WorkerAddress | None) -> dict[str, Any]:
    """Limits and hopper of the job at work, as its log's sidecar has them; the console's own
    where it has none."""
    from topdress.console.services.running_limits import at_work

    found = None if where is None else at_work(where.log_path)
    return (
        {}
        if found is None
        else {"limits_kg_ha": (0.0, found.most_rate_kg_ha), "hopper_kg": found.hopper_kg}
    )


class SharedWaits:
    """In a file of this user, so that another tab of the same address, or the same one loaded
    again, waits as long. Those of other addresses do not: who types wrong keys keeps nobody
    else out."""

    def __init__(self, path: Path, address: str = "") -> None:
        self._path, self._address = path, find_counting_key(address)

    @contextlib.contextmanager
    def taken(self) -> Iterator[SharedWaits | None]:
        try:
            private_folder(self._path.parent)
            lock = take_lock(self._path.with_suffix(".lock"))
        except OSError:
            lock = None
        if lock is None:
            yield None
            return
        with lock:
            yield self

    def read(self) -> tuple[float, float]:
        return self._all().get(self._address, (0.0, float("-inf")))

    def write(self, wait_s: float, until_s: float) -> None:
        """Raises OSError: a key whose waiting cannot be kept opens nothing."""
        others = {
            address: waits for address, waits in self._all().items() if address != self._address
        }
        newest = sorted(others.items(), key=lambda one: one[1][1])[-MOST_ADDRESSES:]
        write_private(
            self._path, json.dumps(dict(newest) | {self._address: (wait_s, until_s)}).encode()
        )

    def _all(self) -> dict[str, tuple[float, float]]:
        try:
            return {
                str(address): (float(wait_s), float(until_s))
                for address, (wait_s, until_s) in json.loads(
                    self._path.read_bytes()[:MOST_BYTES]
                ).items()
            }
        except (OSError, ValueError, TypeError, AttributeError):
            return {}


def find_counting_key(address: str) -> str:
    """Under what an address's wrong keys are counted: of IPv6 the network, in which one
    computer has any address."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    found = getattr(found, "ipv4_mapped", None) or found
    return (
        str(found) if found.version == 4 else str(ipaddress.ip_network((found, 64), strict=False))
    )


def bounded() -> None:
    """A tab is nobody's first concern: little memory, and the processor when the control worker
    leaves it."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        os.nice(TAB_NICE)
    try:
        import resource
    except ImportError:  # Windows has none
        return
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (TAB_BYTES, TAB_BYTES))


def end_with(server: int) -> None:
    """When the server that started this tab is gone, however it ended, the tab and what it
    started end too."""
    while os.getppid() == server:
        time.sleep(PARENT_S)
    if os.getpgid(0) == os.getpid():  # a group of its own, as the server makes it
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def make_tab_app(where: WorkerAddress | None, token: str | None) -> TabletApp:
    """The app of one tab, looking."""
    from topdress.console.services.diagnosis import DiagnosisFiles
    from topdress.console.services.field import field_picture
    from topdress.console.services.line_files import LinesSeen
    from topdress.console.services.running_limits import earlier

    waits = SharedWaits(
        default_run_file().with_name("tablet-waits.json"), os.environ.get(ADDRESS, "")
    )
    source = None if where is None else TabLink(where.looking_only())
    return TabletApp(
        source,
        link_to,
        Key(token, time.monotonic, waits),
        **read_options(where),
        services=Services(
            field=field_picture, diagnosis=DiagnosisFiles(), earlier=earlier, lines=LinesSeen()
        ),
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="topdress.console.cli.tablet")
    parser.add_argument("--token-file", type=Path)
    given = parser.parse_args()
    bounded()
    # elsewhere the next drawing finds nobody who reads it
    if os.name == "posix" and SERVER in os.environ:
        threading.Thread(target=end_with, args=(int(os.environ[SERVER]),), daemon=True).start()
    try:
        where = find_running()
    except WorkerFailed:
        where = None
    make_tab_app(where, read_token(given.token_file)).run()


if __name__ == "__main__":
    main()

"""How does one tab of `topdress serve` run? The server starts `python -m
topdress.console.cli.tablet [--token-file F]`.
"""

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
from topdress.console.app.tablet_app import NO_MACHINE_TEXT, TabletApp, TabletKey
from topdress.console.link import Link
from topdress.console.locale import _
from topdress.console.running import (
    WorkerAddress,
    WorkerFailed,
    find_default_run_file,
    find_running_worker,
)
from topdress.console.serve import ADDRESS_VARIABLE, SERVER_VARIABLE
from topdress.console.worker.real_time import make_private_folder, write_private_file
from topdress.drivers.files.process_lock import take_lock

# Limit of the address space, bytes; a tab with a long log has some 2 GB of addresses, and uses a
# tenth.
TAB_MEMORY_BYTES = 4 << 30
TAB_NICENESS = 10
# Number of addresses whose wrong keys are counted, more than a cab's network has, and size of the
# file, bytes.
MAX_ADDRESSES, MAX_WAITS_BYTES = 100, 20_000
# Interval at which a tab checks whether its server still runs, s.
PARENT_POLL_S = 0.5


class TabLink(Link):
    """Connects a tab, which never keeps the machine working, because that is the duty of the
    console on the machine. If that console is gone, the worker holds, even if a sleeping tablet
    still has a page open."""

    keeps_alive = False
    tablet = True


async def make_tab_link(
    operating: bool, find: Callable[[], WorkerAddress | None] = find_running_worker
) -> Link:
    """Returns a link to the running worker, without its token unless the tab operates. Raises
    WorkerFailed."""
    where = await asyncio.to_thread(find)
    if where is None:
        raise WorkerFailed(_(NO_MACHINE_TEXT))
    return TabLink(where if operating else where.drop_token())


def read_token(path: Path | None) -> str | None:
    """Returns the first line of the token file; None for a missing or empty file."""
    if path is None:
        return None
    try:
        lines = path.read_text(encoding="utf-8").strip().splitlines()
    except OSError:
        return None
    return lines[0].strip() if lines and lines[0].strip() else None


def read_options(where: WorkerAddress | None) -> dict[str, Any]:
    """Returns limits and hopper of the present job from its log's sidecar; the console's own
    without a sidecar."""
    from topdress.console.services.running_limits import read_running_limits

    found = None if where is None else read_running_limits(where.log_path)
    return (
        {}
        if found is None
        else {"limits_kg_ha": (0.0, found.most_rate_kg_ha), "hopper_kg": found.hopper_kg}
    )


class SharedKeyWaits:
    """Stores the waits after wrong keys in a file of this user, so that every tab of the same
    address waits equally long, also after a reload. Other addresses do not wait, so a user who
    types wrong keys excludes nobody else."""

    def __init__(self, path: Path, address: str = "") -> None:
        self._path, self._address = path, find_counting_key(address)

    @contextlib.contextmanager
    def take_lock(self) -> Iterator[SharedKeyWaits | None]:
        try:
            make_private_folder(self._path.parent)
            lock = take_lock(self._path.with_suffix(".lock"))
        except OSError:
            lock = None
        if lock is None:
            yield None
            return
        with lock:
            yield self

    def read_wait(self) -> tuple[float, float]:
        return self._read_all_waits().get(self._address, (0.0, float("-inf")))

    def write_wait(self, wait_s: float, until_s: float) -> None:
        """Stores a wait. Raises OSError, because a key whose wait cannot be stored must open
        nothing."""
        others = {
            address: waits
            for address, waits in self._read_all_waits().items()
            if address != self._address
        }
        newest = sorted(others.items(), key=lambda one: one[1][1])[-MAX_ADDRESSES:]
        write_private_file(
            self._path, json.dumps(dict(newest) | {self._address: (wait_s, until_s)}).encode()
        )

    def _read_all_waits(self) -> dict[str, tuple[float, float]]:
        try:
            return {
                str(address): (float(wait_s), float(until_s))
                for address, (wait_s, until_s) in json.loads(
                    self._path.read_bytes()[:MAX_WAITS_BYTES]
                ).items()
            }
        except (OSError, ValueError, TypeError, AttributeError):
            return {}


def find_counting_key(address: str) -> str:
    """Returns the key under which an address's wrong keys are counted: for IPv6 the network, in
    which one computer can use any address."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    found = getattr(found, "ipv4_mapped", None) or found
    return (
        str(found) if found.version == 4 else str(ipaddress.ip_network((found, 64), strict=False))
    )


def limit_resources() -> None:
    """Limits the tab's memory, and lowers its priority below the control worker."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        os.nice(TAB_NICENESS)
    try:
        import resource
    # Windows has no such module.
    except ImportError:
        return
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (TAB_MEMORY_BYTES, TAB_MEMORY_BYTES))


def end_with_server(server: int) -> None:
    """Ends the tab and its child processes when the server that started it has ended, for whatever
    reason."""
    while os.getppid() == server:
        time.sleep(PARENT_POLL_S)
    # The server starts each tab in a process group of its own.
    if os.getpgid(0) == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def make_tab_app(where: WorkerAddress | None, token: str | None) -> TabletApp:
    """Returns the app of one tab, without the right to order."""
    from topdress.console.services.diagnosis import DiagnosisFiles
    from topdress.console.services.field import make_field_picture
    from topdress.console.services.line_files import ReadOnlyGuideLineFiles
    from topdress.console.services.running_limits import read_earlier_run

    waits = SharedKeyWaits(
        find_default_run_file().with_name("tablet-waits.json"), os.environ.get(ADDRESS_VARIABLE, "")
    )
    source = None if where is None else TabLink(where.drop_token())
    return TabletApp(
        source,
        make_tab_link,
        TabletKey(token, time.monotonic, waits),
        **read_options(where),
        services=Services(
            field=make_field_picture,
            diagnosis=DiagnosisFiles(),
            earlier=read_earlier_run,
            lines=ReadOnlyGuideLineFiles(),
        ),
    )


def run_tab() -> None:
    parser = argparse.ArgumentParser(prog="topdress.console.cli.tablet")
    parser.add_argument("--token-file", type=Path)
    given = parser.parse_args()
    limit_resources()
    # On other systems the next drawing fails, because its reader is gone.
    if os.name == "posix" and SERVER_VARIABLE in os.environ:
        threading.Thread(
            target=end_with_server, args=(int(os.environ[SERVER_VARIABLE]),), daemon=True
        ).start()
    try:
        where = find_running_worker()
    except WorkerFailed:
        where = None
    make_tab_app(where, read_token(given.token_file)).run()


if __name__ == "__main__":
    run_tab()

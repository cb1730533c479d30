"""Contains everything that differs between Linux, macOS and Windows: signals, priority, access
rights.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

# Above the usual threads of the system, below those of the kernel's interrupts (50).
FIFO_PRIORITY = 20
# Python's threads switch at least with this period, s: the loop never waits longer for another
# thread.
SWITCH_INTERVAL_S = 0.001


def handle_signals(stop: Callable[[str], None]) -> None:
    """Ignore Ctrl-C and a closed terminal, which concern the console; stop cleanly on a request to
    terminate."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("SIGHUP", "SIGPIPE"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    for name in ("SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), lambda *_, name=name: stop(name))


def set_priority(wanted: str | None) -> str:
    """Set real-time priority for this thread and all threads that start later; return why it was
    refused, or "".

    All threads need the priority: a thread without it may hold the interpreter's lock while the
    system does not let it run.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    if not wanted:
        return ""
    if sys.platform != "linux":
        return "TOPDRESS_FIFO: real-time priority is known on Linux only; going on without"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except OSError as error:
        return (
            f"TOPDRESS_FIFO: {error.strerror}; going on without (needs an rtprio limit of "
            f"{FIFO_PRIORITY} or more)"
        )
    return ""


def make_private_folder(folder: Path) -> None:
    """Create a folder for its owner only, if it is missing. Raises PermissionError if it belongs to
    somebody else."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if hasattr(os, "geteuid") and folder.stat().st_uid != os.geteuid():
        raise PermissionError(f"{folder}: belongs to another user")


def write_private_file(path: Path, data: bytes) -> None:
    """Write a file that only its owner reads, completely or not at all."""
    unfinished = path.with_name(f"{path.name}.{os.getpid()}")
    unfinished.unlink(missing_ok=True)
    # `O_EXCL` refuses a file that somebody else has prepared; the mode is set at creation, so
    # nobody can read the token in between.
    with os.fdopen(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(data)
    os.replace(unfinished, path)

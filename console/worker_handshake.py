"""Which program listens at the address in a run file? The greeting of a control worker is read
without its key.
"""

from __future__ import annotations

import json
import os
import socket
import time
from pathlib import Path
from typing import Any

WORKER_HOST = "127.0.0.1"
WORKER_GREETING = "topdress-worker/1"
# Time within which a worker must greet, s. It greets at once, and rewrites a wrong run file within
# half of that time.
GREETING_TIMEOUT_S = 0.5
# Longest frame that is accepted, bytes.
MAX_FRAME_BYTES = 1 << 20


def read_greeting(port: int, until_s: float) -> dict[str, Any] | None:
    """Returns the greeting of the program that listens at a port.

    Returns {} where no program listens or the line is no greeting. None means that the connection
    was accepted, but no whole line arrived by `until_s` (time.monotonic), even if single bytes did.
    """
    heard = b""
    try:
        with socket.create_connection(
            (WORKER_HOST, port), timeout=GREETING_TIMEOUT_S
        ) as connection:
            while b"\n" not in heard and len(heard) < MAX_FRAME_BYTES:
                connection.settimeout(max(0.001, until_s - time.monotonic()))
                got = connection.recv(4096)
                if not got:
                    break
                heard += got
                if time.monotonic() > until_s:
                    return None
        said = json.loads(heard.split(b"\n")[0])
    except TimeoutError:
        return None
    except (OSError, ValueError, RecursionError):
        return {}
    return said if isinstance(said, dict) else {}


def is_still_running(run_file: Path) -> bool:
    """Returns whether the worker that a run file names, another process than this, greets: it then
    runs, even if its lock is lost.

    A missing or wrong file, a closed port or another program's port mean False. Takes at most 0.5
    s.
    """
    try:
        said = json.loads(run_file.read_bytes()[:MAX_FRAME_BYTES])
        port, pid = said["port"], said["pid"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False
    if (
        type(port) is not int
        or type(pid) is not int
        or not 0 < port < 1 << 16
        or pid == os.getpid()
    ):
        return False
    greeting = read_greeting(port, time.monotonic() + GREETING_TIMEOUT_S)
    return (
        greeting is not None
        and greeting.get("hello") == WORKER_GREETING
        and greeting.get("pid") == pid
    )

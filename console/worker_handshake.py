"""Who listens where a run file says? Reads the greeting of a control worker, without its key."""

from __future__ import annotations

import json
import os
import socket
import time
from pathlib import Path
from typing import Any

HOST = "127.0.0.1"
GREETING = "topdress-worker/1"
# a worker greets at once, and mends its run file within half of that
GREETING_TIMEOUT_S = 0.5
LINE_BYTES = 1 << 20  # longest frame accepted


def read_greeting(port: int, until_s: float) -> dict[str, Any] | None:
    """The greeting of whoever listens at a port.

    Returns {} where nobody does or it is no greeting; None: accepted, and no whole line by
    `until_s` (time.monotonic), however often a byte came.
    """
    heard = b""
    try:
        with socket.create_connection((HOST, port), timeout=GREETING_TIMEOUT_S) as connection:
            while b"\n" not in heard and len(heard) < LINE_BYTES:
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
    """Whether the worker that a run file names, another than this process, greets there: it runs,
    whatever became of its lock.

    A file that is missing or wrong, a port that is closed or another program's: no. Takes 0.5 s at
    most.
    """
    try:
        said = json.loads(run_file.read_bytes()[:LINE_BYTES])
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
    return greeting is not None and greeting.get("hello") == GREETING and greeting.get("pid") == pid

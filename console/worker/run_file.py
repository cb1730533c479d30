"""The run file: where a worker listens and what opens it, for its own user only; `console.link` reads it."""
from __future__ import annotations

import json
import os
from datetime import UTC, datetime
from pathlib import Path

from console.worker.system import private_folder, write_private


def write(path: Path, port: int, token: str, log_path: str) -> None:
    """Say where this process listens. A file left by a worker that died is replaced. Raises OSError."""
    private_folder(path.parent)
    started = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    say = {"port": port, "token": token, "pid": os.getpid(), "started": started, "log_path": log_path}
    write_private(path, json.dumps(say).encode() + b"\n")


def remove(path: Path) -> None:
    """Remove the file if it is still this process's own."""
    try:
        if json.loads(path.read_bytes()).get("pid") == os.getpid():
            path.unlink()
    except (OSError, ValueError):
        pass

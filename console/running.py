"""How is the control worker started as a process of its own, and how is a running worker found?

Programs that start a worker import this module first, so it needs no slow imports.
"""

from __future__ import annotations

import contextlib
import json
import os
import stat
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from topdress.console.locale import _
from topdress.console.worker_handshake import (
    GREETING_TIMEOUT_S,
    MAX_FRAME_BYTES,
    WORKER_GREETING,
    is_still_running,
    read_greeting,
)
from topdress.drivers.files.process_lock import take_lock

# Interval at which a missing run file is searched again, s.
RUN_FILE_POLL_S = 0.02
# Time-out of a start, s, because opening devices may be slow.
START_TIMEOUT_S = 20.0
# Folder of the session folders (pam_systemd(8)).
SESSION_FOLDERS = Path("/run/user")
OTHERS_WRITE_BITS = stat.S_IWGRP | stat.S_IWOTH
WORKER_ARGUMENTS = ("-P", "-m", "topdress.console.worker")


class WorkerFailed(RuntimeError):
    """Reports that the worker could not start; the message is the worker's last line."""


@dataclass(frozen=True, slots=True)
class WorkerAddress:
    """Holds the address at which a worker listens. A console without the token may only look."""

    port: int
    token: str | None
    pid: int
    # Start in UTC, ISO 8601.
    started: str = ""
    log_path: str = ""
    # Id of the process that started the worker.
    parent: int = 0

    def drop_token(self) -> WorkerAddress:
        """Returns the address without the token."""
        return replace(self, token=None)


def find_default_run_file() -> Path:
    """Returns the file in the user's runtime folder in which a running worker publishes its
    address. Raises WorkerFailed where that folder is open to other users."""
    import platformdirs

    if os.name != "posix" or sys.platform == "darwin":
        folder = Path(platformdirs.user_runtime_dir("topdress", appauthor=False))
    else:
        session = _find_session_folder()
        # Without a folder of a session, the user's own folder under HOME is used.
        folder = (
            Path(platformdirs.user_state_dir("topdress", appauthor=False)) / "run"
            if session is None
            else session / "topdress"
        )
    _refuse_open_folder(folder)
    return folder / "worker.json"


def _find_session_folder() -> Path | None:
    """Returns the folder of this user's session: XDG_RUNTIME_DIR, else systemd's folder; None
    without a session.

    Raises WorkerFailed where the folder belongs to another user, as after `su` or `sudo`, so that
    no other user's machine is joined by mistake.
    """
    named = os.environ.get("XDG_RUNTIME_DIR", "")
    if named:
        _refuse_open_folder(Path(named))
        return Path(named) if Path(named).is_dir() else None
    usual = SESSION_FOLDERS / str(os.getuid())
    return usual if usual.is_dir() and not _is_open_to_others(usual) else None


def _is_open_to_others(folder: Path) -> bool:
    """Returns whether another user owns the folder, or may create files in it."""
    found = folder.stat()
    return found.st_uid != os.getuid() or bool(found.st_mode & OTHERS_WRITE_BITS)


def _refuse_open_folder(folder: Path) -> None:
    """Raises WorkerFailed for an existing folder that is open to other users."""
    if os.name == "posix" and folder.is_dir() and _is_open_to_others(folder):
        raise WorkerFailed(
            _(
                "{path}: a runtime folder that another user owns or may write to: allowed is one "
                "of your own (chmod 700), named by XDG_RUNTIME_DIR, or none"
            ).format(path=folder)
        )


def find_running_worker(run_file: Path | None = None) -> WorkerAddress | None:
    """Returns the worker that runs for this user; None without a worker, and while a worker is
    starting. Takes at most 0.5 s.

    A run file is removed only if no worker holds the lock next to it. A missing or wrong run file
    of a running worker is rewritten by that worker, and the function waits for it. Raises
    WorkerFailed for a running worker whose file stays wrong, or that does not greet in time.
    """
    path = run_file or find_default_run_file()
    until_s = time.monotonic() + GREETING_TIMEOUT_S
    while True:
        wrong: WorkerFailed | None = None
        try:
            if _is_lock_free(path):
                return None
            return _confirm_greeting(_read_run_file(path), until_s)
        except FileNotFoundError:
            pass
        except WorkerFailed as error:
            wrong = error
        if time.monotonic() + RUN_FILE_POLL_S > until_s:
            if wrong is not None:
                raise wrong
            return None
        time.sleep(RUN_FILE_POLL_S)


def _confirm_greeting(where: WorkerAddress, until_s: float) -> WorkerAddress:
    """Returns the same address after the worker has greeted. Raises WorkerFailed."""
    greeting = read_greeting(where.port, until_s)
    if greeting is None:
        raise WorkerFailed(
            _(
                "the machine that runs on this computer does not answer: restart the "
                "computer, or end "
                "program {pid}"
            ).format(pid=where.pid)
        )
    if greeting.get("hello") != WORKER_GREETING or greeting.get("pid") != where.pid:
        raise WorkerFailed(
            _(
                "the machine that runs on this computer does not listen on its port {port}: "
                "restart the "
                "computer, or end program {pid}"
            ).format(pid=where.pid, port=where.port)
        )
    return where


def _is_lock_free(path: Path) -> bool:
    """Returns whether no worker runs; the file that a worker left is then removed, while no worker
    can start."""
    try:
        # Windows has no user ids, so both sides are 0.
        if path.stat().st_uid != getattr(os, "getuid", int)():
            raise WorkerFailed(_("{path}: belongs to another user; remove it").format(path=path))
    except FileNotFoundError:
        pass
    try:
        lock = take_lock(path.with_suffix(".lock"))
    # The folder does not exist either.
    except FileNotFoundError:
        return True
    if lock is None:
        return False
    with lock:
        # The lock's file was removed while the worker held it; the worker will lock this file next.
        if is_still_running(path):
            return False
        path.unlink(missing_ok=True)
    return True


def _read_run_file(path: Path) -> WorkerAddress:
    try:
        said = json.loads(path.read_bytes()[:MAX_FRAME_BYTES])
        port, pid, parent = said["port"], said["pid"], said.get("parent", 0)
        if not all(type(number) is int for number in (port, pid, parent)) or not 0 < port < 1 << 16:
            raise ValueError
        return WorkerAddress(
            port,
            str(said["token"]),
            pid,
            str(said.get("started", "")),
            str(said.get("log_path", "")),
            parent,
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise WorkerFailed(
            _(
                "{path}: does not say how to reach the machine that runs: restart the "
                "computer, or end "
                "that program"
            ).format(path=path)
        ) from None


def start_worker(
    args: Sequence[str],
    trouble_path: str | Path,
    *,
    run_file: Path | None = None,
    timeout_s: float = START_TIMEOUT_S,
    program: Sequence[str] = WORKER_ARGUMENTS,
) -> WorkerAddress:
    """Starts a worker in a session of its own and returns its address.

    The function blocks: it is called before the console starts, or in a thread of its own.

    Parameters
    ----------
    args : arguments of the worker.
    trouble_path : file to which the worker's stderr is appended, because the console draws on
    stderr.
    program : arguments of the interpreter.

    Raises
    ------
    WorkerFailed : a worker already runs, the new worker ends at once, or it does not publish its
    address within `timeout_s`.
    """
    path = run_file or find_default_run_file()
    running = find_running_worker(path)
    if running:
        raise WorkerFailed(
            _("a machine runs already on this computer (program {pid}): join it").format(
                pid=running.pid
            )
        )
    apart = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0) | getattr(
        subprocess, "CREATE_NO_WINDOW", 0
    )
    with open(trouble_path, "ab") as trouble:
        heard_before = trouble.tell()
        child = subprocess.Popen(
            [sys.executable, *program, "--run-file", str(path), *args],
            stdin=subprocess.DEVNULL,
            stdout=trouble,
            stderr=trouble,
            start_new_session=True,
            creationflags=apart,
        )
    until = time.monotonic() + timeout_s
    while time.monotonic() < until:
        if child.poll() is not None:
            last = _read_last_line(Path(trouble_path), heard_before) or _(
                "ended at once, code {code}"
            ).format(code=child.returncode)
            raise WorkerFailed(_("the machine did not start: {last}").format(last=last))
        where = None
        # A worker that holds the lock may not greet yet.
        with contextlib.suppress(WorkerFailed):
            where = find_running_worker(path)
        # On Windows the program of the virtual environment starts the interpreter as its child.
        if where and child.pid in (where.pid, where.parent):
            return where
        time.sleep(RUN_FILE_POLL_S)
    child.terminate()
    raise WorkerFailed(
        _("the machine said nothing for {limit_s:g} s; see {path}").format(
            limit_s=timeout_s, path=trouble_path
        )
    )


def _read_last_line(path: Path, start: int) -> str:
    with open(path, "rb") as file:
        file.seek(start)
        lines = file.read().decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")

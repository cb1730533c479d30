"""The control worker as a process of its own: start it, or find the one that runs.

Imported before all else by what starts one: nothing heavy is needed for it.
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
    GREETING,
    GREETING_TIMEOUT_S,
    LINE_BYTES,
    is_still_running,
    read_greeting,
)
from topdress.drivers.files.lock import take_lock

# a run file that is not there yet is looked for this often
POLL_S = 0.02
START_TIMEOUT_S = 20.0  # opening devices may take its time
SESSION_FOLDERS = Path("/run/user")  # pam_systemd(8)
OTHERS_WRITE_BITS = stat.S_IWGRP | stat.S_IWOTH
WORKER_ARGUMENTS = ("-P", "-m", "topdress.console.worker")


class WorkerFailed(RuntimeError):
    """The worker could not start; the message is its own last line."""


@dataclass(frozen=True, slots=True)
class WorkerAddress:
    """Holds where a worker listens. Without the token the console only looks."""

    port: int
    token: str | None
    pid: int
    started: str = ""  # UTC, ISO 8601
    log_path: str = ""
    parent: int = 0  # the process that started it

    def drop_token(self) -> WorkerAddress:
        """The address without the token."""
        return replace(self, token=None)


def find_default_run_file() -> Path:
    """The file in the user's runtime folder in which a running worker says where it listens. Raises
    WorkerFailed where that folder is open to other users."""
    import platformdirs

    if os.name != "posix" or sys.platform == "darwin":
        folder = Path(platformdirs.user_runtime_dir("topdress", appauthor=False))
    else:
        session = _find_session_folder()
        # no folder of a session: the user's own, which goes by HOME
        folder = (
            Path(platformdirs.user_state_dir("topdress", appauthor=False)) / "run"
            if session is None
            else session / "topdress"
        )
    _refuse_open_folder(folder)
    return folder / "worker.json"


def _find_session_folder() -> Path | None:
    """The folder of this user's session, where there is one: as XDG_RUNTIME_DIR names it, else
    where systemd keeps it.

    Raises WorkerFailed where the named one is another user's, as after `su` or `sudo`: no other
    user's machine is joined by mistake.
    """
    named = os.environ.get("XDG_RUNTIME_DIR", "")
    if named:
        _refuse_open_folder(Path(named))
        return Path(named) if Path(named).is_dir() else None
    usual = SESSION_FOLDERS / str(os.getuid())
    return usual if usual.is_dir() and not _is_open_to_others(usual) else None


def _is_open_to_others(folder: Path) -> bool:
    """Whether another user owns the folder, or may put files there."""
    found = folder.stat()
    return found.st_uid != os.getuid() or bool(found.st_mode & OTHERS_WRITE_BITS)


def _refuse_open_folder(folder: Path) -> None:
    """Raises WorkerFailed where the folder is there and open to other users."""
    if os.name == "posix" and folder.is_dir() and _is_open_to_others(folder):
        raise WorkerFailed(
            _(
                "{path}: a runtime folder that another user owns or may write to: allowed is one "
                "of your own (chmod 700), named by XDG_RUNTIME_DIR, or none"
            ).format(path=folder)
        )


def find_running_worker(run_file: Path | None = None) -> WorkerAddress | None:
    """The worker that runs for this user, or None, also while one is just starting. Takes 0.5 s at
    most.

    A run file is removed only where no worker holds the lock next to it. One that is missing or
    wrong while a worker runs is written anew by that worker, and waited for. Raises WorkerFailed
    where a worker runs and its file stays wrong, or where it does not greet in time.
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
        if time.monotonic() + POLL_S > until_s:
            if wrong is not None:
                raise wrong
            return None
        time.sleep(POLL_S)


def _confirm_greeting(where: WorkerAddress, until_s: float) -> WorkerAddress:
    """The same address, once the worker there has greeted. Raises WorkerFailed."""
    greeting = read_greeting(where.port, until_s)
    if greeting is None:
        raise WorkerFailed(
            _(
                "the machine that runs on this computer does not answer: restart the "
                "computer, or end "
                "program {pid}"
            ).format(pid=where.pid)
        )
    if greeting.get("hello") != GREETING or greeting.get("pid") != where.pid:
        raise WorkerFailed(
            _(
                "the machine that runs on this computer does not listen on its port {port}: "
                "restart the "
                "computer, or end program {pid}"
            ).format(pid=where.pid, port=where.port)
        )
    return where


def _is_lock_free(path: Path) -> bool:
    """Whether no worker runs; the file that one left is then removed, while none can start."""
    try:
        if path.stat().st_uid != getattr(os, "getuid", int)():  # Windows: 0 on both sides
            raise WorkerFailed(_("{path}: belongs to another user; remove it").format(path=path))
    except FileNotFoundError:
        pass
    try:
        lock = take_lock(path.with_suffix(".lock"))
    except FileNotFoundError:  # not even the folder is there
        return True
    if lock is None:
        return False
    with lock:
        # the lock's file was removed under it: it locks this one next
        if is_still_running(path):
            return False
        path.unlink(missing_ok=True)
    return True


def _read_run_file(path: Path) -> WorkerAddress:
    try:
        said = json.loads(path.read_bytes()[:LINE_BYTES])
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
    """Start a worker in a session of its own and wait until it says where it listens.

    Blocks: call it before the console starts, or in a thread of its own. Raises WorkerFailed where
    one runs already, where it ends at once, or where it says nothing for `timeout_s`.

    Parameters
    ----------
    args: the worker's own arguments.
    trouble_path: the worker's stderr is appended there, because the console draws on stderr.
    program: the interpreter's arguments.
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
        with contextlib.suppress(WorkerFailed):  # it has the lock, and does not greet yet
            where = find_running_worker(path)
        # Windows: the environment's own program starts it
        if where and child.pid in (where.pid, where.parent):
            return where
        time.sleep(POLL_S)
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

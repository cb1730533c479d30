"""Runs one tab's console as a process in a process group of its own, which ends completely and
soon.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Sequence
from typing import Any

from textual_serve.app_service import AppService
from topdress.console.attached_consoles import NAME_VARIABLE
from topdress.console.serve import ADDRESS_VARIABLE, SERVER_VARIABLE

# Time for a console to end after a request, s; idle it takes 0.2 s. Then the system terminates it.
QUIT_TIMEOUT_S = 0.5
# Time to end after SIGTERM, s, before SIGKILL; both times are half of the 2 s in which everything
# has ended.
TERMINATE_TIMEOUT_S = 0.2


class TabConsole(AppService):
    """Runs one tab's console as a process.

    Parameters
    ----------
    command
        Program and arguments; no shell is started, because a signal would end the shell instead of
        the console.
    name
        Name of the tab among the machine's consoles.
    address
        Address from which the tab was opened.
    """

    def __init__(self, command: Sequence[str], name: str, address: str, **options: Any) -> None:
        super().__init__(" ".join(command), **options)
        self._arguments, self._name, self._address = tuple(command), name, address
        self._ending: asyncio.Task[None] | None = None

    async def _open_app_process(
        self, width: int = 80, height: int = 24
    ) -> asyncio.subprocess.Process:
        """Start the console's process in a group of its own, so that signals reach everything that
        it starts."""
        apart: dict[str, Any] = {"start_new_session": True} if os.name == "posix" else {}
        process = await asyncio.create_subprocess_exec(
            *self._arguments,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env=self._build_environment(width=width, height=height),
            **apart,
        )
        assert process.stdin is not None
        self._process, self._stdin = process, process.stdin
        return process

    def _build_environment(self, width: int = 80, height: int = 24) -> dict[str, str]:
        """Return the environment of the console's process."""
        return super()._build_environment(width, height) | {
            SERVER_VARIABLE: str(os.getpid()),
            NAME_VARIABLE: self._name,
            ADDRESS_VARIABLE: self._address,
        }

    async def run(self) -> None:
        """Run as any console; a console that ends by itself closes its tab."""
        try:
            await super().run()
        finally:
            if self._ending is None:
                await self.remote_close()

    async def end_console(self) -> None:
        """Return after the console and everything that it started have ended, within 2 s: first
        requested, then killed."""
        if self._ending is None:
            self._ending = asyncio.create_task(self._end_process())
        # The shield lets the end continue if one of several callers is cancelled.
        await asyncio.shield(self._ending)

    async def _end_process(self) -> None:
        """End the process in three steps: request, SIGTERM, SIGKILL."""
        process = self._process
        if process is None:
            return
        await self._request_quit(process)
        # Otherwise the base class would report that a console that was ended failed to start.
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        _send_group_signal(process, "SIGTERM")
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(process.wait(), TERMINATE_TIMEOUT_S)
        _send_group_signal(process, "SIGKILL")
        await process.wait()

    async def _request_quit(self, process: asyncio.subprocess.Process) -> None:
        """Ask the console to quit, and wait for its end for a limited time."""
        with contextlib.suppress(TimeoutError, OSError, RuntimeError):
            async with asyncio.timeout(QUIT_TIMEOUT_S):
                await self._download_manager.cancel_app_downloads(
                    app_service_id=self.app_service_id
                )
                await self.send_meta({"type": "quit"})
                await process.wait()


def _send_group_signal(process: asyncio.subprocess.Process, name: str) -> None:
    """Send a signal to the console and everything that it started; on Windows to the console only.
    A missing group means that all have ended."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if os.name == "posix":
            os.killpg(process.pid, getattr(signal, name))
        elif process.returncode is None:
            process.kill()

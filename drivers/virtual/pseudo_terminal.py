"""A pseudo-terminal as the virtual machine's end of a serial line, under a name that stays. POSIX systems only."""
from __future__ import annotations

import contextlib
import os
import select
import sys
from pathlib import Path

from drivers.ports import READ_TIMEOUT_S, Clock, ThreadedPort


class TerminalPort(ThreadedPort):
    """The device's end; a program opens the name `link` as it would a serial port. Connected while one has it open.

    Raises
    ------
    OSError : the system has no pseudo-terminals, or the link cannot be made.
    """

    def __init__(self, link: Path, clock: Clock) -> None:
        self._link = link
        self._master = -1
        self._make()
        super().__init__(str(link), self._wait_for_a_program, clock, first_back_off_s=0.01, longest_back_off_s=0.01)

    def let_go(self) -> None:
        """Unplugged: the terminal and its name are gone, as when a USB plug is pulled."""
        if self._master >= 0:
            with contextlib.suppress(OSError):
                os.close(self._master)
            self._master = -1
            self._link.unlink(missing_ok=True)

    def close(self) -> None:
        super().close()
        self.let_go()

    def _wait_for_a_program(self) -> _MasterStream:
        if self._master < 0:
            self._make()
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        if any(event & select.POLLHUP for _, event in poll.poll(0)):
            raise TimeoutError("no program has it open")
        return _MasterStream(self._master)

    def _make(self) -> None:
        if sys.platform == "win32":
            raise OSError("this system has no pseudo-terminals")
        import tty
        self._master, slave = os.openpty()
        tty.setraw(slave)
        name = os.ttyname(slave)
        os.set_blocking(self._master, False)
        os.close(slave)
        self._link.parent.mkdir(parents=True, exist_ok=True)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(name)


class _MasterStream:
    """Reading ends with OSError when the program closes its end; what it does not take in time is lost."""

    def __init__(self, master: int) -> None:
        self._master = master

    def read(self) -> bytes:
        if not select.select([self._master], [], [], READ_TIMEOUT_S)[0]:
            return b""
        return os.read(self._master, 4096)

    def write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        """The terminal outlives the program that had it open."""

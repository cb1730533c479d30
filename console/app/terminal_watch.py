"""Ends a console with its terminal: hung up, closed, or no longer writable."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

# Time for a console without terminal to end by itself, s. The console may be in a write that never
# returns, or wait for a thread that starts a machine.
EXIT_GRACE_S = 1.0
# Exit code for a cancelled program, as listed in `topdress --help`.
EXIT_CANCELLED = 130
# Handles that Textual reads (stdin) and draws on (stderr).
TERMINAL_HANDLES = (0, 2)
# Textual's name of the thread that writes to the terminal.
WRITER_THREAD = "textual-output"
# Escape sequences: Kitty keyboard off, mouse off, bracketed paste off, line wrap on, alternate
# screen off, cursor on, focus reports off.
PLAIN_TERMINAL = b"\x1b[<u\x1b[?1000l\x1b[?1003l\x1b[?2004l\x1b[?7h\x1b[?1049l\x1b[?25h\x1b[?1004l"
# Longest wait for a terminal that accepts no output, s.
RESTORE_TIMEOUT_S = 0.2


class TerminalWatch:
    """Waits for the end of a terminal in a thread of its own.

    Textual's input thread reads the end of file repeatedly, its output thread dies of a failed
    write, and neither reports it. The signal of a hang-up does not arrive where another program,
    such as `make`, leads the terminal's session.
    """

    def __init__(
        self,
        leave: Callable[[], object],
        handles: tuple[int, ...] = TERMINAL_HANDLES,
        grace_s: float = EXIT_GRACE_S,
        end: Callable[[int], object] = os._exit,
    ) -> None:
        """Create the watch.

        Parameters
        ----------
        leave
            Asks the program to end by itself; called from the watch's thread.
        handles
            Handles of the terminal.
        grace_s
            Time for the program to end by itself, s.
        end
            Ends the process after `grace_s`.
        """
        self._leave, self._handles, self._grace_s, self._end = leave, handles, grace_s, end
        self._attributes = _read_attributes(handles[0])
        # A pipe wakes the poll from any thread and from a signal handler, where locks are
        # forbidden.
        self._woken, self._wake = os.pipe()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run_watch, name="terminal-watch", daemon=True)
        self.is_gone = False

    def start_watch(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop_watch(self) -> None:
        """End the thread, because the program has ended by itself."""
        self._over.set()
        self.hang_up()
        self._thread.join()
        os.close(self._woken)
        os.close(self._wake)

    def hang_up(self) -> None:
        """Act as if the terminal were gone; callable from any thread and from a signal handler."""
        os.write(self._wake, b"x")

    def _run_watch(self) -> None:
        """Wait for the end of the terminal, then ask the program to leave, and end it after the
        grace time."""
        ends = select.poll()
        for handle in self._handles:
            # `poll` reports hang-up and error for any mask, so the mask is empty.
            ends.register(handle, 0)
        ends.register(self._woken, select.POLLIN)
        while not any(self._is_terminal_end(ends, *event) for event in ends.poll()):
            pass
        if self._over.is_set():
            return
        self.is_gone = True
        self._leave()
        if not self._over.wait(self._grace_s):
            self._restore_terminal()
            self._end(EXIT_CANCELLED)

    def _is_terminal_end(self, ends: select.poll, handle: int, events: int) -> bool:
        """Return whether an event is a hang-up, an error or a wake-up. A handle that the system
        cannot poll (terminals of older macOS) is left to the signals."""
        if handle == self._woken or events & (select.POLLHUP | select.POLLERR):
            return True
        ends.unregister(handle)
        return False

    def _restore_terminal(self) -> None:
        """Restore the modes of the terminal that Textual was unable to restore."""
        import termios

        if self._attributes is not None:
            with contextlib.suppress(termios.error, OSError):
                termios.tcsetattr(self._handles[0], termios.TCSANOW, self._attributes)
        # A thread writes, because a write to a stopped terminal would block for ever.
        writes = threading.Thread(target=self._write_plain_modes, daemon=True)
        writes.start()
        writes.join(RESTORE_TIMEOUT_S)

    def _write_plain_modes(self) -> None:
        """Write the sequences that return the terminal to its plain modes."""
        if os.isatty(self._handles[-1]):
            with contextlib.suppress(OSError):
                os.write(self._handles[-1], PLAIN_TERMINAL)


def _read_attributes(handle: int) -> list[Any] | None:
    """Return the modes of the terminal before Textual changes them; None if it is no terminal."""
    import termios

    try:
        return termios.tcgetattr(handle)
    except (termios.error, OSError):
        return None


@contextlib.contextmanager
def leave_with_terminal(
    leave: Callable[[], object],
    watch_of: Callable[[Callable[[], object]], TerminalWatch] = TerminalWatch,
) -> Iterator[Callable[[], bool]]:
    """Run the block on this terminal, and leave when the terminal is hung up or unwritable, or
    after SIGHUP or SIGTERM. Yields a function that returns whether that happened.

    A hang-up that the caller ignores (nohup) stays ignored. Windows ends a console with its window.
    """
    if sys.platform == "win32":
        yield lambda: False
        return
    watch = watch_of(leave)
    signals = [
        one for one in (signal.SIGHUP, signal.SIGTERM) if signal.getsignal(one) != signal.SIG_IGN
    ]
    before = {one: signal.signal(one, lambda *_: watch.hang_up()) for one in signals}
    said_before = threading.excepthook

    def note_thread_death(what: threading.ExceptHookArgs) -> None:
        # An output thread that dies means that the terminal cannot be written to.
        if what.thread is not None and what.thread.name == WRITER_THREAD:
            watch.hang_up()
        else:
            said_before(what)

    threading.excepthook = note_thread_death
    watch.start_watch()
    try:
        yield lambda: watch.is_gone
    finally:
        threading.excepthook = said_before
        for one, handler in before.items():
            signal.signal(one, handler)
        # Work at the end may wait for a thread. After a hang-up the watch therefore continues, and
        # ends the process after the grace time.
        if not watch.is_gone:
            watch.stop_watch()

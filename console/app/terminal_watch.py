"""A console ends with its terminal: hung up, closed, or no longer to be written to."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

# A console whose terminal is gone has that long to end by itself. It may be in the middle of a
# write that never returns, or wait for a thread that starts a machine.
GRACE_S = 1.0
# of `topdress --help`: cancelled
EXIT_CANCELLED = 130
# what Textual reads, and what it draws on
TERMINAL_HANDLES = (0, 2)
# what Textual calls the thread that writes on the terminal
WRITER_THREAD = "textual-output"
# Kitty's keys off, mouse off, alternate screen off, cursor on, focus reports off.
PLAIN_TERMINAL = b"\x1b[<u\x1b[?1000l\x1b[?1003l\x1b[?2004l\x1b[?7h\x1b[?1049l\x1b[?25h\x1b[?1004l"
RESTORE_TIMEOUT_S = 0.2  # a terminal that takes nothing is not waited for


class TerminalWatch:
    """Waits for the end of a terminal in a thread of its own.

    Textual's input thread reads the end of file over and over, its output thread dies of a
    write that fails, and neither says so. The hang-up's signal does not come where another
    program, such as `make`, leads the terminal's session.
    """

    def __init__(
        self,
        leave: Callable[[], object],
        handles: tuple[int, ...] = TERMINAL_HANDLES,
        grace_s: float = GRACE_S,
        end: Callable[[int], object] = os._exit,
    ) -> None:
        """leave: asks the program to end by itself, from the watch's thread. handles: of the
        terminal. end: ends the process where it did not leave within `grace_s`."""
        self._leave, self._handles, self._grace_s, self._end = leave, handles, grace_s, end
        self._attributes = _read_attributes(handles[0])
        self._woken, self._wake = os.pipe()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run_watch, name="terminal-watch", daemon=True)
        self.is_gone = False

    def start_watch(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop_watch(self) -> None:
        """End the thread: the program has ended by itself."""
        self._over.set()
        self.hang_up()
        self._thread.join()
        os.close(self._woken)
        os.close(self._wake)

    def hang_up(self) -> None:
        """Act as if the terminal were gone. From any thread, and from a signal's handler."""
        os.write(self._wake, b"x")

    def _run_watch(self) -> None:
        ends = select.poll()
        for handle in self._handles:
            # poll reports hang-up and error whatever is asked for
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
        """Whether this is a hang-up, an error or a wake-up. A handle that this system cannot watch
        (terminals of older macOS) is left to the signals."""
        if handle == self._woken or events & (select.POLLHUP | select.POLLERR):
            return True
        ends.unregister(handle)
        return False

    def _restore_terminal(self) -> None:
        """Restore what Textual was not able to put back."""
        import termios

        if self._attributes is not None:
            with contextlib.suppress(termios.error, OSError):
                termios.tcsetattr(self._handles[0], termios.TCSANOW, self._attributes)
        writes = threading.Thread(target=self._write_plain_modes, daemon=True)
        writes.start()
        writes.join(RESTORE_TIMEOUT_S)

    def _write_plain_modes(self) -> None:
        if os.isatty(self._handles[-1]):
            with contextlib.suppress(OSError):
                os.write(self._handles[-1], PLAIN_TERMINAL)


def _read_attributes(handle: int) -> list[Any] | None:
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
    """Run the block on this terminal, and leave when the terminal is hung up or cannot be written
    to, or when SIGHUP or SIGTERM ask for it. Yields whether that was so.

    A hang-up that the caller ignores (nohup) stays ignored. On Windows the system ends a console
    with its window.
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
        # What is left to do at the end may wait for a thread: after a hang-up the watch stays,
        # and ends the process when the grace is over.
        if not watch.is_gone:
            watch.stop_watch()

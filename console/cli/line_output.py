"""Lines for whoever reads standard output, without waiting for them."""

from __future__ import annotations

import os
import queue
import select
import sys
import threading
from collections.abc import Callable

# Lines that wait for a reader: some 100 KB, ten seconds of a machine at work. He who takes none
# misses lines until he does.
MOST_WAITING_LINES = 100
POLL_S = 0.25  # how soon a reader is missed who is gone while nothing is written


class LineOutput:
    """Writes lines on a handle by a thread of its own: a pipe that nobody reads, or a terminal that
    stands, delays nobody else. It writes past Python's own buffer, whose lock such a write would
    hold beyond the end of the program."""

    def __init__(self, handle: int, ended: Callable[[], object]) -> None:
        """ended: called from the thread once nobody can read any more."""
        self._handle, self._ended = handle, ended
        self._lines: queue.Queue[bytes] = queue.Queue(MOST_WAITING_LINES)
        threading.Thread(target=self._write_lines, name="line-output", daemon=True).start()

    def queue_line(self, line: bytes) -> None:
        """Put the line behind those that wait, or drop it where too many do."""
        if not self._lines.full():
            self._lines.put_nowait(line)

    def _write_lines(self) -> None:
        try:
            while not _has_no_reader(self._handle):
                try:
                    rest = self._lines.get(timeout=POLL_S)
                except queue.Empty:
                    continue
                while rest:
                    rest = rest[os.write(self._handle, rest) :]
        except OSError:
            pass
        self._ended()


def _has_no_reader(handle: int) -> bool:
    """Whether the other end of a pipe is closed; on Windows only a write finds out."""
    if sys.platform == "win32":
        return False
    ends = select.poll()
    # poll reports hang-up and error whatever is asked for
    ends.register(handle, 0)
    gone = select.POLLHUP | select.POLLERR
    return any(events & gone for _handle, events in ends.poll(0))

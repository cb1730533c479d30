"""How are lines written to standard output without waiting for their reader?"""

from __future__ import annotations

import os
import queue
import select
import sys
import threading
from collections.abc import Callable

# Number of lines that wait for a reader: some 100 KB, ten seconds of a working machine. A reader
# that does not read misses lines meanwhile.
MAX_WAITING_LINES = 100
# Interval at which a closed reader is detected while nothing is written, s.
READER_POLL_S = 0.25


class LineOutput:
    """Writes lines on a handle by a thread of its own, so that an unread pipe or a stopped terminal
    delays no other thread.

    It bypasses Python's own buffer, because such a write would hold the buffer's lock beyond the
    end of the program.
    """

    def __init__(self, handle: int, ended: Callable[[], object]) -> None:
        """`ended` is called from the thread after the reader has closed."""
        self._handle, self._ended = handle, ended
        self._lines: queue.Queue[bytes] = queue.Queue(MAX_WAITING_LINES)
        threading.Thread(target=self._write_lines, name="line-output", daemon=True).start()

    def queue_line(self, line: bytes) -> None:
        """Queues the line, or drops it if too many lines wait."""
        if not self._lines.full():
            self._lines.put_nowait(line)

    def _write_lines(self) -> None:
        try:
            while not _has_no_reader(self._handle):
                try:
                    rest = self._lines.get(timeout=READER_POLL_S)
                except queue.Empty:
                    continue
                while rest:
                    rest = rest[os.write(self._handle, rest) :]
        except OSError:
            pass
        self._ended()


def _has_no_reader(handle: int) -> bool:
    """Returns whether the other end of a pipe is closed; on Windows only a write detects it."""
    if sys.platform == "win32":
        return False
    ends = select.poll()
    # poll reports hang-up and error for every mask.
    ends.register(handle, 0)
    gone = select.POLLHUP | select.POLLERR
    return any(events & gone for _handle, events in ends.poll(0))

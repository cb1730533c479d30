"""Appends to files next to the log in a thread, so that the loop never waits for a disk."""

from __future__ import annotations

import queue
import threading
from pathlib import Path


class SideFiles:
    """Appends in the order of the calls, each time at the end of the file. `trouble` has the last
    failure."""

    def __init__(self) -> None:
        self.trouble = ""
        self._queue: queue.SimpleQueue[tuple[Path, bytes] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def queue_append(self, path: Path, data: bytes) -> None:
        """Queue bytes and return at once; they are in the file within about a second."""
        # The thread starts on first use, because most runs write no such file.
        if self._thread is None:
            self._thread = threading.Thread(
                target=self._write_queued, name="side files", daemon=True
            )
            self._thread.start()
        self._queue.put((path, data))

    def close_files(self, timeout_s: float = 2.0) -> None:
        """Write everything that is queued. The thread starts again with the next `queue_append`."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join(timeout_s)
            self._thread = None

    def _write_queued(self) -> None:
        """Write queued bytes until the end mark; runs in the thread."""
        while (first := self._queue.get()) is not None:
            path, data = first
            try:
                # The file is opened for each write, so that another program may move it in between.
                with open(path, "ab") as file:
                    file.write(data)
            except OSError as error:
                self.trouble = f"{path}: {error.strerror or error}"

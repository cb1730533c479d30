"""Files written next to the log: a thread of its own appends to them, so that the loop never
waits for a disk."""

from __future__ import annotations

import queue
import threading
from pathlib import Path


class SideFiles:
    """Appends in the order of the calls, each time to the end of the file. Failures are reported in
    `trouble`."""

    def __init__(self) -> None:
        self.trouble = ""
        self._queue: queue.SimpleQueue[tuple[Path, bytes] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def queue_append(self, path: Path, data: bytes) -> None:
        """Queue bytes and return at once; they are in the file within a second or so."""
        if self._thread is None:
            self._thread = threading.Thread(
                target=self._write_queued, name="side files", daemon=True
            )
            self._thread.start()
        self._queue.put((path, data))

    def close_files(self, timeout_s: float = 2.0) -> None:
        """Write what is queued. A thread may begin again with the next `queue_append`."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join(timeout_s)
            self._thread = None

    def _write_queued(self) -> None:
        while (first := self._queue.get()) is not None:
            path, data = first
            try:
                with open(path, "ab") as file:
                    file.write(data)
            except OSError as error:
                self.trouble = f"{path}: {error.strerror or error}"

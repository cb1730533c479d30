"""Files written next to the log: a thread of its own appends to them, so that the loop never
waits for a disk."""

from __future__ import annotations

import queue
import threading
from pathlib import Path


class SideFiles:
    """Appends in the order of the calls, each time to the end of what is there. What fails is
    reported in `trouble`."""

    def __init__(self) -> None:
        self.trouble = ""
        self._queue: queue.SimpleQueue[tuple[Path, bytes] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def append(self, path: Path, data: bytes) -> None:
        """Returns at once; the bytes are in the file within a second or so."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="side files", daemon=True)
            self._thread.start()
        self._queue.put((path, data))

    def close(self, timeout_s: float = 2.0) -> None:
        """Write what is queued. A thread may begin again with the next `append`."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join(timeout_s)
            self._thread = None

    def _work(self) -> None:
        while (first := self._queue.get()) is not None:
            path, data = first
            try:
                with open(path, "ab") as file:
                    file.write(data)
            except OSError as error:
                self.trouble = f"{path}: {error.strerror or error}"

"""What the Map page is given beside the machine: files of other days that can be laid on it."""
from __future__ import annotations

from typing import Protocol

from console.app.laid import LaidFile
from console.app.pages.replay.log_files import LogFile
from console.frame import Frame


class LayerFiles(Protocol):
    """Errors are one-line ValueErrors."""

    def files(self, running_log: str) -> tuple[LogFile, ...]:
        """The newest first, without the log that is being written."""

    def lay(self, path: str, frame: Frame) -> LaidFile:
        """Reads a file onto the plane of a frame that has a position; seconds for a long one."""

"""What the Map page is given: files of another day laid on it, and the lines that are kept next
to the log."""

from __future__ import annotations

from typing import Protocol

from topdress.console.app.guide_line_store import KeptLines
from topdress.console.app.overlay_file import LaidFile
from topdress.console.app.pages.replay.service import LogFile
from topdress.console.frame import Frame


class LayerFiles(Protocol):
    """Errors are one-line ValueErrors."""

    def list_layer_files(self, running_log: str) -> tuple[LogFile, ...]:
        """The newest first, without the log that is being written."""

    def make_overlay(self, path: str, frame: Frame) -> LaidFile:
        """Reads a file onto the plane of a frame that has a position; seconds for a long one."""


class LineFiles(Protocol):
    def append_record(self, log_path: str, record: str) -> None:
        """Kept next to the log; returns at once."""

    def read_lines(self, log_path: str) -> KeptLines:
        """What holds, with what the log tells of the drive since; where nothing was said of a
        line, that of the last job on the same field. Takes its time; never raises."""

"""What the Map page is given: files of another day laid on it, and the lines that are kept next
to the log."""

from __future__ import annotations

from typing import Protocol

from topdress.console.app.guide_line_store import KeptLines
from topdress.console.app.overlay_file import LaidFile
from topdress.console.app.pages.replay.service import LogFile
from topdress.console.frame import Frame


class LayerFiles(Protocol):
    """Reads files to lay on the map. Errors are one-line ValueErrors."""

    def list_layer_files(self, running_log: str) -> tuple[LogFile, ...]:
        """Files, the newest first, without the log that is being written."""

    def make_overlay(self, path: str, frame: Frame) -> LaidFile:
        """Read a file onto the plane of a frame that has a position; seconds for a long one."""


class LineFiles(Protocol):
    """Keeps lines next to the log."""

    def append_record(self, log_path: str, record: str) -> None:
        """Keep a record next to the log; returns at once."""

    def read_lines(self, log_path: str) -> KeptLines:
        """The lines in force, with the log's part of the drive since; without a record of a line,
        that of the last job on the same field. Takes its time; never raises."""

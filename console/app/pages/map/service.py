"""Declares the functions that the Map page receives: files of other days to overlay, and lines
stored next to the log.
"""

from __future__ import annotations

from typing import Protocol

from topdress.console.app.guide_line_store import StoredLines
from topdress.console.app.overlay_file import OverlayFile
from topdress.console.app.pages.replay.service import LogFile
from topdress.console.frame import Frame


class OverlayFiles(Protocol):
    """Reads files to overlay on the map. Errors are one-line ValueErrors."""

    def list_layer_files(self, running_log: str) -> tuple[LogFile, ...]:
        """Return the files, newest first, without the log that is being written."""

    def make_overlay(self, path: str, frame: Frame) -> OverlayFile:
        """Read a file onto the plane of a frame with a position; a long file takes seconds."""


class GuideLineFiles(Protocol):
    """Stores lines next to the log."""

    def append_record(self, log_path: str, record: str) -> None:
        """Append a record to the file next to the log; returns at once."""

    def read_lines(self, log_path: str) -> StoredLines:
        """Return the lines in force, and the log's part of the drive since its last record.

        Without a record of a line, the line of the last job on the same field is returned. This
        function blocks and never raises.
        """

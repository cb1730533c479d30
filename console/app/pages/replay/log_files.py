"""What the Replay page is given next to a log: the logs that can be opened."""
from __future__ import annotations

from typing import NamedTuple, Protocol

from console.app.replay_job import ReplayJob


class LogFile(NamedTuple):
    """changed: local date and time, to the minute. size: "12.3 MB"."""

    path: str
    name: str
    changed: str
    size: str


class LogFiles(Protocol):
    """Errors are one-line ValueErrors."""

    def logs(self) -> tuple[LogFile, ...]:
        """The newest first."""

    def open(self, path: str) -> ReplayJob:
        """Reads a log for the page; seconds for a long one."""

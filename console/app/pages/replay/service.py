"""Declares the data and functions that the Replay page receives: a log to play, its recomputation,
and the logs that can be opened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from topdress.console.app.replay_source import ReplaySource
from topdress.console.frame import Frame


class WhatIf(NamedTuple):
    """Describes a recomputation; None means as recorded."""

    strategy: str | None = None
    crop: str | None = None
    machine: str | None = None


IsCancelled = Callable[[], bool]
TellShare = Callable[[float], None]
# Receives the changes, a cancellation check and a progress function; returns the frames.
WhatIfComputer = Callable[[WhatIf, IsCancelled, TellShare], Sequence[Frame]]


@dataclass(frozen=True, slots=True)
class ReplayJob:
    """Holds a log to play.

    Attributes
    ----------
    source
        Source of the frames.
    name
        Name of the log as displayed.
    findings
        Notes on the log.
    what_if
        Computes other frames in a thread; errors are one-line ValueErrors. It checks `cancelled`
        between rows and then returns the frames so far; `tell` receives the share done.
    crops, machines
        Names of the alternatives.
    """

    source: ReplaySource
    name: str
    # Notes on the log, in the language in use.
    findings: tuple[str, ...] = ()
    what_if: WhatIfComputer | None = None
    # Names of shipped and own files.
    crops: tuple[str, ...] = ()
    machines: tuple[str, ...] = ()


class LogFile(NamedTuple):
    """Describes a log. `changed` is the local date and time to the minute, `size` a text such as
    "12.3 MB"."""

    path: str
    name: str
    changed: str
    size: str


class LogFiles(Protocol):
    """Lists and opens logs. Errors are one-line ValueErrors."""

    def list_logs(self) -> tuple[LogFile, ...]:
        """Return the logs, newest first."""

    def open_log(self, path: str) -> ReplayJob:
        """Read a log for the page; a long log takes seconds."""

"""What the Replay page is given: a log to play, how a what-if of it is computed, and the logs
that can be opened."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from topdress.console.app.replay_source import ReplaySource
from topdress.console.frame import Frame


class WhatIf(NamedTuple):
    """Describes a what-if; None: as recorded."""

    strategy: str | None = None
    crop: str | None = None
    machine: str | None = None


IsCancelled = Callable[[], bool]
TellShare = Callable[[float], None]
WhatIfComputer = Callable[[WhatIf, IsCancelled, TellShare], Sequence[Frame]]


@dataclass(frozen=True, slots=True)
class ReplayJob:
    """Holds a log to play.

    name: of the log, as shown. what_if: computes other frames, in a thread; errors are one-line
    ValueErrors. It asks `cancelled` between rows and then returns at once with the frames so far;
    `tell` takes the share that is done.
    """

    source: ReplaySource
    name: str
    findings: tuple[str, ...] = ()
    what_if: WhatIfComputer | None = None
    crops: tuple[str, ...] = ()
    machines: tuple[str, ...] = ()


class LogFile(NamedTuple):
    """Describes a log. changed: local date and time, to the minute. size: "12.3 MB"."""

    path: str
    name: str
    changed: str
    size: str


class LogFiles(Protocol):
    """Lists and opens logs. Errors are one-line ValueErrors."""

    def list_logs(self) -> tuple[LogFile, ...]:
        """Logs, the newest first."""

    def open_log(self, path: str) -> ReplayJob:
        """Read a log for the page; seconds for a long one."""

"""What the Replay page is given: a log to play, how a what-if of it is computed, and the logs
that can be opened."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from topdress.console.app.replay_source import ReplaySource
from topdress.console.frame import Frame


class WhatIf(NamedTuple):
    """What is other than recorded; None: as recorded."""

    strategy: str | None = None
    crop: str | None = None
    machine: str | None = None


Cancelled = Callable[[], bool]
Tell = Callable[[float], None]
ComputeAnew = Callable[[WhatIf, Cancelled, Tell], Sequence[Frame]]


@dataclass(frozen=True, slots=True)
class ReplayJob:
    """name: of the log, as shown. what_if: computes other frames, in a thread; errors are
    one-line ValueErrors. It asks `cancelled` between rows and then comes back at once with
    whatever it has; `tell` takes the share that is done."""

    source: ReplaySource
    name: str
    findings: tuple[str, ...] = ()
    what_if: ComputeAnew | None = None
    crops: tuple[str, ...] = ()
    machines: tuple[str, ...] = ()


class LogFile(NamedTuple):
    """changed: local date and time, to the minute. size: "12.3 MB"."""

    path: str
    name: str
    changed: str
    size: str


class LogFiles(Protocol):
    """Errors are one-line ValueErrors."""

    def list_logs(self) -> tuple[LogFile, ...]:
        """The newest first."""

    def open_log(self, path: str) -> ReplayJob:
        """Reads a log for the page; seconds for a long one."""

"""What screens can have done that needs files or long work. The command line gives it; None:
not offered here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar, cast

if TYPE_CHECKING:
    from topdress.console.app.field_picture import FieldPicture
    from topdress.console.app.pages.calibrate.service import CalibrateService
    from topdress.console.app.pages.diagnosis.service import DiagnosisService
    from topdress.console.app.pages.job.service import EarlierRun, JobService, RunningLimits
    from topdress.console.app.pages.map.service import LayerFiles, LineFiles
    from topdress.console.app.pages.replay.service import LogFiles
    from topdress.console.app.pages.settings.service import SettingsStore
    from topdress.console.frame import Frame
    from topdress.control.diagnosis.result import Departure

Service = TypeVar("Service")


class _LateService:
    def __init__(self, make: Callable[[], object]) -> None:
        self._made, self._lock = cache(make), Lock()

    def make_or_find(self) -> object:
        with self._lock:
            return self._made()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.make_or_find(), name)


def make_late(make: Callable[[], Service]) -> Service:
    """A service that is made, with the imports that it needs, when it is first used: the first
    picture does without."""
    return cast(Service, _LateService(make))


@dataclass(frozen=True, slots=True)
class Services:
    """Holds the services of the screens. Each field belongs to one screen. Its errors are one-line
    ValueErrors; long work runs in a thread and asks `cancelled` between steps."""

    calibrate: CalibrateService | None = None

    settings: SettingsStore | None = None

    job: JobService | None = None

    # outline and planned rates of a frame's job
    field: Callable[[Frame], FieldPicture | None] | None = None

    diagnosis: DiagnosisService | None = None

    logs: LogFiles | None = None

    layers: LayerFiles | None = None

    earlier: Callable[[str], EarlierRun | None] | None = None  # before this console looked

    # the limits of the run that writes a log
    at_work: Callable[[str], RunningLimits | None] | None = None

    # of the Map page: the A-B line, a boundary that is being driven
    lines: LineFiles | None = None

    # of the log at a path, so far; returns at once
    model_check: Callable[[str], Departure | None] | None = None
    # a sentence for the start: what this console does without
    missing: str = ""

    # begins a command that plays a sound; why it did not, empty: it did
    play: Callable[[str], str] | None = None

    def make_late_services(self) -> None:
        """Make those that are late, in a thread: each imports much."""
        for one in fields(self):
            if isinstance(found := getattr(self, one.name), _LateService):
                found.make_or_find()

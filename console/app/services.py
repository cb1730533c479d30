"""Declares the files and long work that screens need. The command line supplies them; None means
that a service is not available.
"""

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
    from topdress.console.app.pages.map.service import GuideLineFiles, OverlayFiles
    from topdress.console.app.pages.replay.service import LogFiles
    from topdress.console.app.pages.settings.service import SettingsStore
    from topdress.console.frame import Frame
    from topdress.control.diagnosis.result import ModelDeviation

Service = TypeVar("Service")


class _LateService:
    """Makes a service on first use, once, from any thread."""

    def __init__(self, make: Callable[[], object]) -> None:
        self._made, self._lock = cache(make), Lock()

    def make_or_find(self) -> object:
        # Two threads may ask at the same time, and `cache` alone would make the service twice.
        """Return the service, made on first use."""
        with self._lock:
            return self._made()

    def __getattr__(self, name: str) -> Any:
        """Forward to the service itself."""
        return getattr(self.make_or_find(), name)


def make_late_service(make: Callable[[], Service]) -> Service:
    """Return a service that is made with its imports on first use, because the first picture does
    not need it."""
    return cast(Service, _LateService(make))


@dataclass(frozen=True, slots=True)
class Services:
    """Holds the services of the screens, one field per screen. Errors are one-line ValueErrors;
    long work runs in a thread and checks `cancelled` between steps."""

    calibrate: CalibrateService | None = None

    settings: SettingsStore | None = None

    job: JobService | None = None

    # Returns outline and planned rates of a frame's job.
    field: Callable[[Frame], FieldPicture | None] | None = None

    diagnosis: DiagnosisService | None = None

    logs: LogFiles | None = None

    layers: OverlayFiles | None = None

    # Returns what the log contains from before this console's first frame.
    earlier: Callable[[str], EarlierRun | None] | None = None

    # Returns the limits of the run that writes a log.
    at_work: Callable[[str], RunningLimits | None] | None = None

    # Stores the A-B line and a boundary in progress for the Map page.
    lines: GuideLineFiles | None = None

    # Returns the deviation of the log at a path from its model so far; returns at once.
    model_check: Callable[[str], ModelDeviation | None] | None = None
    # Sentence for the start: what this console lacks.
    missing: str = ""

    # Starts a command that plays a sound, and returns why it failed, or "".
    play: Callable[[str], str] | None = None

    def make_late_services(self) -> None:
        """Make the late services in a thread, because each imports much."""
        for one in fields(self):
            if isinstance(found := getattr(self, one.name), _LateService):
                found.make_or_find()

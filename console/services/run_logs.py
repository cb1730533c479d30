"""Which logs can the Replay page open? They are in the user's folder and in the working folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from topdress.console.app.pages.diagnosis.service import IMPORT_KIND, DiagnosisSource
from topdress.console.app.pages.replay.service import LogFile, ReplayJob
from topdress.console.services.diagnosis import DiagnosisFiles
from topdress.console.services.foreign_files import YAML_SUFFIXES


def select_logs(sources: Iterable[DiagnosisSource]) -> tuple[LogFile, ...]:
    """Returns the sources that are run logs, as files of the Replay page."""
    return tuple(
        LogFile(one.path, one.name, one.changed, one.size)
        for one in sources
        if one.kind in ("run", IMPORT_KIND) and not one.name.endswith(YAML_SUFFIXES)
    )


class RunLogs:
    """Implements `console.app.pages.replay.service.LogFiles` on real files."""

    def __init__(self, files: DiagnosisFiles | None = None) -> None:
        self._files = files or DiagnosisFiles()

    def list_logs(self) -> tuple[LogFile, ...]:
        """Returns logs that can be replayed, the newest first."""
        return select_logs(self._files.list_sources(""))

    def open_log(self, path: str) -> ReplayJob:
        """Returns a log opened for replay. Raises ValueError, OSError."""
        from topdress.console.services.replay_frames import open_replay
        from topdress.drivers.files.any_log import open_any_log

        return open_replay(open_any_log(Path(path)))

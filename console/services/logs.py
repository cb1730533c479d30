"""The logs that the Replay page can open: those of the user's folder and of the present one."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from topdress.console.app.pages.diagnosis.service import IMPORT, DiagnosisSource
from topdress.console.app.pages.replay.service import LogFile, ReplayJob
from topdress.console.services.diagnosis import DiagnosisFiles
from topdress.console.services.foreign_files import YAML


def select_logs(sources: Iterable[DiagnosisSource]) -> tuple[LogFile, ...]:
    return tuple(
        LogFile(one.path, one.name, one.changed, one.size)
        for one in sources
        if one.kind in ("run", IMPORT) and not one.name.endswith(YAML)
    )


class RunLogs:
    """`console.app.pages.replay.service.LogFiles` on real files."""

    def __init__(self, files: DiagnosisFiles | None = None) -> None:
        self._files = files or DiagnosisFiles()

    def logs(self) -> tuple[LogFile, ...]:
        return select_logs(self._files.sources(""))

    def open(self, path: str) -> ReplayJob:
        from topdress.console.services.replay_frames import open_replay
        from topdress.drivers.files.any_log import open_log

        return open_replay(open_log(Path(path)))

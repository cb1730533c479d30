"""The A-B line and a boundary that is being driven, kept beside the log as NAME.lines.jsonl."""
from __future__ import annotations

from pathlib import Path

from console.app.kept_lines import KeptLines, kept_lines
from console.worker import resume
from console.worker.side_files import SideFiles

ENDING = ".lines.jsonl"


def beside(log_path: str | Path) -> Path:
    return Path(log_path).with_suffix(ENDING)


class KeptLineFiles:
    """`console.app.kept_lines.LineFiles` on real files."""

    def __init__(self) -> None:
        self._files = SideFiles()

    def append(self, log_path: str, record: str) -> None:
        self._files.append(beside(log_path), record.encode() + b"\n")

    def read(self, log_path: str) -> KeptLines:
        """Of the job's parts before a power cut too: what was said last holds."""
        texts = [(log, _text(beside(log))) for log in (*_parts_before(log_path), Path(log_path))]
        kept = kept_lines(record for _log, text in texts for record in text.splitlines())
        if kept.drive is None:
            return kept
        logs = [log for log, _text in texts]
        last = max(index for index, (_log, text) in enumerate(texts) if text)
        for log in logs[last:]:
            _drive_on(kept, log, kept.until_s if log == logs[last] else -1.0)
        return kept

    def close(self) -> None:
        self._files.close()


def _drive_on(kept: KeptLines, log: Path, after_s: float) -> None:
    """The way since the last record, while no console looked: the log has it."""
    from drivers.files.read_log import LogError, read_log
    assert kept.drive is not None
    try:
        for row in read_log(log).rows():
            if row.time_s > after_s:
                kept.drive.add(row)
    except (LogError, ValueError, OSError):
        return                              # the last side is drawn straight


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _parts_before(log_path: str) -> tuple[Path, ...]:
    try:
        return tuple(map(Path, resume.read(resume.beside(log_path)).logs_before))
    except (OSError, ValueError):
        return ()


class LinesSeen(KeptLineFiles):
    """Of a console that writes no files: a tablet's tab."""

    def append(self, log_path: str, record: str) -> None:
        """Not kept."""

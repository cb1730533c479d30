"""How are the A-B line and a boundary during its drive stored? They are in NAME.lines.jsonl next to
the log.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from topdress.console.app.guide_line_store import StoredLines, read_kept_lines
from topdress.console.worker.side_files import SideFiles

LINES_SUFFIX = ".lines.jsonl"


def find_lines_path(log_path: str | Path) -> Path:
    """Returns the path of the file of lines next to a log."""
    return Path(log_path).with_suffix(LINES_SUFFIX)


class StoredGuideLineFiles:
    """Implements `console.app.pages.map.service.GuideLineFiles` on real files."""

    def __init__(self) -> None:
        self._files = SideFiles()

    def append_record(self, log_path: str, record: str) -> None:
        """Queues a record for the log's file of lines."""
        self._files.queue_append(find_lines_path(log_path), record.encode() + b"\n")

    def read_lines(self, log_path: str) -> StoredLines:
        """Returns the lines of a log, including the job's parts before a power cut; the last record
        applies."""
        texts = [
            (log, _read_text_or_empty(find_lines_path(log)))
            for log in (*_list_earlier_parts(log_path), Path(log_path))
        ]
        kept = read_kept_lines(record for _log, text in texts for record in text.splitlines())
        if not kept.changed:
            kept = _add_field_line(kept, Path(log_path))
        if kept.drive is None:
            return kept
        logs = [log for log, _text in texts]
        last = max(index for index, (_log, text) in enumerate(texts) if text)
        for log in logs[last:]:
            _continue_drive(kept, log, kept.until_s if log == logs[last] else -1.0)
        return kept

    def close_files(self) -> None:
        """Writes queued records."""
        self._files.close_files()


def _add_field_line(kept: StoredLines, log: Path) -> StoredLines:
    """Returns the lines with the line of the last job on the same field, so that tracks stay in
    place."""
    field = _find_shared_field(log)
    if field is None:
        return kept
    # The names begin with the time, so reverse order is the newest first.
    for path in sorted(log.parent.glob(f"*{LINES_SUFFIX}"), reverse=True):
        before = read_kept_lines(_read_text_or_empty(path).splitlines())
        other = path.with_name(path.name.removesuffix(LINES_SUFFIX) + log.suffix)
        if before.changed and other != log:
            found = _find_shared_field(other)
            if found is not None and found.place == field.place:
                return (
                    kept._replace(guide=before.guide, of_day=found.began)
                    if before.guide.is_set
                    else kept
                )
    return kept


class _SharedField(NamedTuple):
    """Holds the plane and the edge that two jobs on one field have in common."""

    place: tuple[object, ...]
    began: str


def _find_shared_field(log: Path) -> _SharedField | None:
    """Returns the field of a log; None for a job without a field, and for an unreadable log."""
    from topdress.drivers.files.run_meta import read_sidecar_meta

    meta = read_sidecar_meta(log)
    field = None if meta is None else (meta.job or {}).get("field")
    if meta is None or not isinstance(field, dict) or not field.get("boundary_m"):
        return None
    return _SharedField(
        tuple(field.get(key) for key in ("origin_lat_deg", "origin_lon_deg", "boundary_m")),
        meta.started_utc or "",
    )


def _continue_drive(kept: StoredLines, log: Path, after_s: float) -> None:
    """Adds the path since the last record, taken from the log, for the time without a console."""
    from topdress.drivers.files.read_log import read_log

    assert kept.drive is not None
    try:
        for row in read_log(log).rows():
            if row.time_s > after_s:
                kept.drive.add_row(row)
    except (ValueError, OSError):
        # The last side is a straight line.
        return


def _read_text_or_empty(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _list_earlier_parts(log_path: str) -> tuple[Path, ...]:
    from topdress.console.worker import resume

    try:
        return tuple(
            map(Path, resume.read_snapshot(resume.make_snapshot_path(log_path)).logs_before)
        )
    except (OSError, ValueError):
        return ()


class ReadOnlyGuideLineFiles(StoredGuideLineFiles):
    """Reads lines for a console that writes no files: a tablet's tab."""

    def append_record(self, log_path: str, record: str) -> None:
        """Does nothing, because a tablet stores no lines."""

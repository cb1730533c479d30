"""The A-B line and a boundary that is being driven, kept next to the log as NAME.lines.jsonl."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from topdress.console.app.guide_line_store import KeptLines, read_kept_lines
from topdress.console.worker.side_files import SideFiles

ENDING = ".lines.jsonl"


def find_lines_path(log_path: str | Path) -> Path:
    return Path(log_path).with_suffix(ENDING)


class KeptLineFiles:
    """`console.app.pages.map.service.LineFiles` on real files."""

    def __init__(self) -> None:
        self._files = SideFiles()

    def append(self, log_path: str, record: str) -> None:
        self._files.append(find_lines_path(log_path), record.encode() + b"\n")

    def read(self, log_path: str) -> KeptLines:
        """Of the job's parts before a power cut too: what was said last holds."""
        texts = [
            (log, _text(find_lines_path(log))) for log in (*_parts_before(log_path), Path(log_path))
        ]
        kept = read_kept_lines(record for _log, text in texts for record in text.splitlines())
        if not kept.changed:
            kept = _of_the_field(kept, Path(log_path))
        if kept.drive is None:
            return kept
        logs = [log for log, _text in texts]
        last = max(index for index, (_log, text) in enumerate(texts) if text)
        for log in logs[last:]:
            _drive_on(kept, log, kept.until_s if log == logs[last] else -1.0)
        return kept

    def close(self) -> None:
        self._files.close()


def _of_the_field(kept: KeptLines, log: Path) -> KeptLines:
    """With the line of the last job on the same field, where there is one: tracks stay where
    they are."""
    field = _field_of(log)
    if field is None:
        return kept
    # their names begin with the time
    for path in sorted(log.parent.glob(f"*{ENDING}"), reverse=True):
        before = read_kept_lines(_text(path).splitlines())
        other = path.with_name(path.name.removesuffix(ENDING) + log.suffix)
        if before.changed and other != log:
            found = _field_of(other)
            if found is not None and found.place == field.place:
                return (
                    kept._replace(guide=before.guide, of_day=found.began)
                    if before.guide.set
                    else kept
                )
    return kept


class _SharedField(NamedTuple):
    """place: what two jobs on one field share: its plane and its edge."""

    place: tuple[object, ...]
    began: str


def _field_of(log: Path) -> _SharedField | None:
    """None: its job has no field, or cannot be read."""
    from topdress.drivers.files.run_meta import sidecar_meta

    meta = sidecar_meta(log)
    field = None if meta is None else (meta.job or {}).get("field")
    if meta is None or not isinstance(field, dict) or not field.get("boundary_m"):
        return None
    return _SharedField(
        tuple(field.get(key) for key in ("origin_lat_deg", "origin_lon_deg", "boundary_m")),
        meta.started_utc or "",
    )


def _drive_on(kept: KeptLines, log: Path, after_s: float) -> None:
    """The way since the last record, while no console looked: the log has it."""
    from topdress.drivers.files.read_log import read_log

    assert kept.drive is not None
    try:
        for row in read_log(log).rows():
            if row.time_s > after_s:
                kept.drive.add(row)
    except (ValueError, OSError):
        return  # the last side is drawn straight


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _parts_before(log_path: str) -> tuple[Path, ...]:
    from topdress.console.worker import resume

    try:
        return tuple(map(Path, resume.read(resume.snapshot_path(log_path)).logs_before))
    except (OSError, ValueError):
        return ()


class LinesSeen(KeptLineFiles):
    """Of a console that writes no files: a tablet's tab."""

    def append(self, log_path: str, record: str) -> None:
        """Not kept."""

"""Which jobs were worked lately? The sidecars of the logs name the files of each job; each set is
listed once, the newest first.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

from topdress.console.app.pages.job.service import JobCard, RecentSet
from topdress.console.services.field import make_job_picture
from topdress.console.worker import resume
from topdress.console.worker.snapshots import list_newest_first
from topdress.control.orders import TargetSource
from topdress.drivers.files.config import find_shipped_files, load_any_config, load_config
from topdress.drivers.files.config_error import ConfigError
from topdress.drivers.files.config_kinds import CAB_KIND, CONFIG_KINDS, JOB_KIND, MACHINE_KIND
from topdress.drivers.files.run_meta import RunMeta, parse_meta_yaml

# Any width is sufficient, because an outline does not depend on it.
OUTLINE_WIDTH_M = 2.4
# Number of the newest logs that are read, a week of a contractor's work, and of jobs.
MAX_SIDECARS = 60


def find_recent_sets(logs: Path, own: Path) -> tuple[RecentSet, ...]:
    """Returns recent file sets, the newest first.

    `logs` is the folder of the logs; `own` are the user's jobs, which are listed too. Sets with a
    missing or unreadable file are omitted.
    """
    done = find_done_of_jobs(logs)
    found: dict[tuple[str, ...], RecentSet] = {}
    for sidecar in _list_newest_sidecars(logs, MAX_SIDECARS):
        with contextlib.suppress(OSError, ValueError, ConfigError):
            one = _find_run_set(parse_meta_yaml(sidecar.read_text(encoding="utf-8")), done)
            if one is not None:
                found.setdefault(one.files, one)
    for path in _list_newest_sidecars(own / JOB_KIND.folder, MAX_SIDECARS):
        if not any(str(path) in one.files for one in found.values()):
            with contextlib.suppress(OSError, ConfigError):
                job = load_config(path, JOB_KIND).model
                found[str(path),] = RecentSet(
                    (str(path),),
                    job.title or path.stem,
                    job.field.title,
                    card=make_job_card(path, done),
                )
    return tuple(found.values())


def find_done_of_jobs(logs: Path) -> dict[Path, tuple[float, str]]:
    """Returns the hectares and the date of the newest run of each job file with which a worker of
    these logs was started."""
    found: dict[Path, tuple[float, str]] = {}
    for path in list_newest_first(logs):
        with contextlib.suppress(OSError, ValueError):
            kept = resume.read_snapshot(path)
            for file in kept.config:
                found.setdefault(Path(file).resolve(), (kept.area_ha, kept.saved_utc))
    return found


def make_job_card(path: Path, done: dict[Path, tuple[float, str]]) -> JobCard | None:
    """Returns the card of a job file; None for an unreadable file. A plan is read only without an
    outline, because a large plan takes seconds."""
    with contextlib.suppress(OSError, ValueError, ConfigError):
        job = load_config(path, JOB_KIND).model
        drawn = (
            job
            if not job.field.boundary_m
            else job.model_copy(
                update={
                    "target": job.target.model_copy(
                        update={"map": None, "source": TargetSource.CANOPY}
                    )
                }
            )
        )
        done_ha, worked_utc = done.get(path.resolve(), (0.0, ""))
        return JobCard(
            job.title or job.id,
            job.field.title,
            Path(job.crop).stem,
            "" if job.target.map is None else Path(job.target.map).name,
            done_ha,
            worked_utc,
            make_job_picture(drawn, path.parent, OUTLINE_WIDTH_M),
        )
    return None


def _list_newest_sidecars(folder: Path, most: int) -> list[Path]:
    times: dict[Path, float] = {}
    with contextlib.suppress(OSError):
        for path in folder.glob("*.yaml"):
            times[path] = path.stat().st_mtime
    return sorted(times, key=lambda path: -times[path])[:most]


def _find_run_set(meta: RunMeta, done: dict[Path, tuple[float, str]]) -> RecentSet | None:
    """Returns the file set of a run; None if all of its files are shipped. Raises ConfigError for a
    missing file."""
    kinds = {}
    for file in meta.sha256:
        if Path(file).suffix.lower() in (".yaml", ".yml"):
            kind, _loaded = load_any_config(Path(file), CONFIG_KINDS)
            if kind in (JOB_KIND, MACHINE_KIND, CAB_KIND):
                kinds[kind.format] = file
    ours = {
        str(path)
        for folder in (JOB_KIND.folder, MACHINE_KIND.folder)
        for path in find_shipped_files(folder).values()
    }
    files = tuple(kinds.values())
    if all(file in ours for file in files):
        return None
    job, machine = meta.job or {}, meta.machine or {}
    field = job.get("field")
    return RecentSet(
        files,
        str(job.get("title") or job.get("id") or ""),
        str(field.get("title") or "") if isinstance(field, dict) else "",
        str(machine.get("title") or machine.get("id") or ""),
        meta.started_utc or "",
        make_job_card(Path(kinds[JOB_KIND.format]), done) if JOB_KIND.format in kinds else None,
    )

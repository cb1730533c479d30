"""Which limits does a running machine use, and what happened earlier in its run? The log's sidecar
has the limits, the snapshot the earlier run.
"""

from __future__ import annotations

from topdress.console.app.pages.job.service import EarlierRun, RunningLimits


def read_running_limits(log_path: str) -> RunningLimits | None:
    """Returns the limits of the running machine; None for a log without a sidecar, or a sidecar
    without limits."""
    from topdress.control.machine.machine import Machine
    from topdress.drivers.files.run_meta import read_sidecar_meta

    meta = read_sidecar_meta(log_path)
    if meta is None:
        return None
    crop, machine = meta.crop or {}, meta.machine or {}
    try:
        found = RunningLimits(float(crop["max_rate_kg_ha"]), float(machine["flow"]["full_kg"]))
    except (ValueError, KeyError, TypeError):
        return None
    try:
        return found._replace(machine=Machine.model_validate(machine))
    except ValueError:
        return found


def read_earlier_run(log_path: str) -> EarlierRun | None:
    """Returns alarms and track of the run so far; None for a missing or unreadable snapshot."""
    from topdress.console.worker import resume

    try:
        kept = resume.read_snapshot(resume.make_snapshot_path(log_path))
    except (OSError, ValueError):
        return None
    return EarlierRun(kept.alarms, kept.track)

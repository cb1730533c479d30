"""What a machine that runs goes by, as its log's sidecar has it: not the files of the console."""
from __future__ import annotations

from pathlib import Path

from console.app.pages.job.service import AtWork
from drivers.files.run_meta import meta_from_yaml


def at_work(log_path: str) -> AtWork | None:
    """None where the log has no sidecar, or one that does not say."""
    try:
        meta = meta_from_yaml(Path(log_path).with_suffix(".yaml").read_text(encoding="utf-8"))
        crop, machine = meta.crop or {}, meta.machine or {}
        return AtWork(float(crop["max_rate_kg_ha"]), float(machine["flow"]["full_kg"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None

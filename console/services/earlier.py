"""What a run did before a console looked at it, as its snapshot has it."""
from __future__ import annotations

from console.app.pages.job.service import Earlier
from console.worker import resume


def earlier(log_path: str) -> Earlier | None:
    """None where there is no snapshot, or none that can be read."""
    try:
        kept = resume.read(resume.beside(log_path))
    except (OSError, ValueError):
        return None
    return Earlier(kept.alarms, kept.track)

"""What a live check says. Loads nothing heavy: the console shows it."""
from __future__ import annotations

from typing import NamedTuple


class Departure(NamedTuple):
    """How the machine departs from its model.

    `cause`: id of an effect, "" where it has no name. `percent`: by how much the dose is wrong, None where that is not
    known or nothing. `since_s`: of the log; None: since it began, or before the stretch that was looked at. `certain`:
    no other effect would do as well. `next_run`: what would tell the rivals apart (`NextRun.plan`).
    """

    channel: str
    cause: str
    percent: float | None
    since_s: float | None
    certain: bool = True
    adoptable: bool = False
    next_run: str = ""
    size: float | None = None
    unit: str = ""

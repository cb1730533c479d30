"""Another run of a machine with a term or a column hidden in it: other drive, other canopy,
other noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from .programmes import PROGRAMMES, Drive, chosen, drive
from .terms import ANGLE
from .truth import Redrive, Redriven

# enough to see errors; the size is not estimated here
MINUTES = (12.0, 14.0)
# of each variable, as a share of that in the first run: else the term is not asked
LEAST_SPREAD = 0.5
# a log with longer rows does not show a turn of the shaft
TURN_SEEN_S = 0.05
TRIES = 60


def another_run(
    redriven: Redriven, truth: dict[str, Any], seed: int, elsewhere: bool
) -> Redrive | None:
    """The same machine driven again, on its own programme or (`elsewhere`) on another one of
    the same half.

    None where no programme of the half moves what the term depends on.
    """
    first = next(p for p in PROGRAMMES if p.name == truth["programme"])
    able = [p for p in chosen(first.split) if (p != first) == elsewhere]
    rng = np.random.default_rng([truth["seed"], truth["number"], seed, 29])
    for _ in range(TRIES):
        programme = able[int(rng.integers(len(able)))]
        driven = drive(programme._replace(minutes=MINUTES), int(rng.integers(1 << 30)))
        if _asks(driven, truth["outside"]["term"]):
            return redriven(_always(driven), int(rng.integers(1 << 30)))
    return None


def _asks(driven: Drive, term: dict[str, Any]) -> bool:
    """Whether the drive moves the variables of a term; an extra column moves on every drive."""
    for name, spread in zip(term["variables"], term["spread"], strict=True):
        if (
            name in Drive._fields
            and name != "time_s"
            and np.std(getattr(driven, name)) < LEAST_SPREAD * spread
        ):
            return False
        if name == ANGLE and driven.row_s > TURN_SEEN_S:
            return False
    return True


def _always(driven: Drive) -> Any:
    def change(_: Drive) -> Drive:
        return driven

    return change

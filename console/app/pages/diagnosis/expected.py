"""How far long work is and how long it still takes: by how much there is to read at first, by its own pace later."""
from __future__ import annotations

START_S = 3.0               # imports and reading, whatever the size
S_PER_MB = 0.6              # of a run log, on two cores
MOST_BY_TIME = 0.3          # of the bar, that time alone may fill: it must not stand at its end for minutes
ENOUGH = 0.2                # of the work, to tell its pace


def expected_s(megabytes: float) -> float:
    """Before anything is known of this computer's pace."""
    return START_S + S_PER_MB * megabytes


class Expected:
    """The bar moves from the start and never back; the time left is reported from the start, and never less than
    none."""

    def __init__(self, whole_s: float) -> None:
        self._whole_s = max(1.0, whole_s)
        self._shown = 0.0

    def at(self, gone_s: float, share: float) -> tuple[float, float | None]:
        """Share of the work to show, and seconds left; None: longer than was thought, and nobody knows how long.

        share: as the work itself tells it. Its own pace counts alone once `ENOUGH` is done.
        """
        own_s = gone_s / share if share > 0.0 else self._whole_s
        trust = min(1.0, share / ENOUGH)
        whole_s = (1.0 - trust) * self._whole_s + trust * own_s
        by_time = min(MOST_BY_TIME, gone_s / max(whole_s, 1e-9))
        self._shown = max(self._shown, min(1.0, max(share, by_time)))
        left_s = whole_s - gone_s
        return self._shown, left_s if left_s > 0.0 else None

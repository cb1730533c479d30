"""A refill recognised by the scale: the machine does not work, the mass rises by more than 5
kg, and settles; and what the scale says against one that is typed. Pure."""

from __future__ import annotations

from collections import deque

from topdress.console.app.units import Unit
from topdress.console.locale import _
from topdress.control.log_row import LogRow

LEAST_RISE_KG = 5.0
SETTLE_TIME_S = 3.0  # the mass must have stood this long ...
SETTLE_RANGE_KG = 1.0  # ... within this
STANDING_MPS = 0.2
LEAST_FILLED_KG = 0.1  # less is no refill
# bags are weighed to a few percent, a scale reads to one: farther apart one is wrong
GROSS_ERROR_SHARE = 0.25
# and both may be off by this: the scale's zero on a slope, what fell next to it
SCALE_ERROR_KG = 5.0


class RefillWatch:
    """Watches rows for a refill. `seen_kg`: mass added since the machine stopped, None while
    nothing was."""

    def __init__(self) -> None:
        self.seen_kg: float | None = None
        # seen at work: no refill came before it was watched
        self._worked = False
        self._window: deque[tuple[float, float]] = deque()
        self._level_kg: float | None = None  # before the refill

    def add_row(self, row: LogRow) -> None:
        """Add a row of the run. Work, movement or a silent scale begins the watch anew."""
        moving = (row.speed_used_mps or 0.0) > STANDING_MPS
        if row.hopper_kg is None or row.state == "working" or moving:
            self._window.clear()
            self._level_kg = None
            if row.state == "working":
                self.seen_kg, self._worked = None, True
            return
        if self._window and row.time_s < self._window[-1][0]:
            self._window.clear()
        self._window.append((row.time_s, row.hopper_kg))
        while row.time_s - self._window[0][0] > SETTLE_TIME_S:
            self._window.popleft()
        masses = [kg for _time, kg in self._window]
        if (
            row.time_s - self._window[0][0] < 0.8 * SETTLE_TIME_S
            or max(masses) - min(masses) > SETTLE_RANGE_KG
        ):
            return
        level_kg = sum(masses) / len(masses)
        if self._level_kg is None or level_kg < self._level_kg:
            self._level_kg = level_kg
        elif level_kg - self._level_kg > LEAST_RISE_KG:
            self.seen_kg = round(level_kg - self._level_kg, 1)

    @property
    def before_kg(self) -> float | None:
        """Mass in the hopper, to which nothing was added since the machine worked, kg; None where
        that is not known."""
        return self._level_kg if self._worked and self.seen_kg is None else None

    def end_refill(self) -> None:
        """Begin anew: it was recorded, or it was none."""
        self.seen_kg = None
        self._level_kg = None
        self._window.clear()


def explain_refill_doubt(
    filled_kg: float, watch: RefillWatch, hopper_kg: float | None, full_kg: float, unit: Unit
) -> str:
    """Why a typed refill is doubted, in words; "" where nothing speaks against it.

    hopper_kg: the scale's reading now. It includes the refill already or does not yet, where
    `watch` does not know.
    """
    if watch.seen_kg is not None:
        if abs(filled_kg - watch.seen_kg) <= max(SCALE_ERROR_KG, GROSS_ERROR_SHARE * watch.seen_kg):
            return ""
        return _("The scale saw {seen} filled in.").format(
            seen=unit.format_with_name(watch.seen_kg)
        )
    if watch.before_kg is not None:
        if watch.before_kg + filled_kg <= full_kg + SCALE_ERROR_KG:
            return ""
        return _("The scale says {now} are in the hopper: {room} more fit.").format(
            now=unit.format_with_name(watch.before_kg),
            room=unit.format_with_name(max(0.0, full_kg - watch.before_kg)),
        )
    if (
        hopper_kg is None
        or filled_kg <= hopper_kg + SCALE_ERROR_KG
        or hopper_kg + filled_kg <= full_kg + SCALE_ERROR_KG
    ):
        return ""
    return _(
        "The scale says {now} are in the hopper now, which holds {full}: neither before nor "
        "after it."
    ).format(now=unit.format_with_name(hopper_kg), full=unit.format_with_name(full_kg))

"""Recognises a refill by the scale: the machine does not work, the mass rises by more than 5 kg and
settles. Compares a typed refill with the scale. Pure.
"""

from __future__ import annotations

from collections import deque

from topdress.console.app.units import Unit
from topdress.console.locale import _
from topdress.control.log_row import LogRow

# Smaller rises, kg, may be a person who climbs on the machine or leans on the hopper.
MIN_RISE_KG = 5.0
# The mass counts as settled after this time, s, ...
SETTLE_TIME_S = 3.0
# ... within this range, kg.
SETTLE_RANGE_KG = 1.0
MAX_STANDING_SPEED_MPS = 0.2
# Smaller masses, kg, are no refill.
MIN_REFILL_KG = 0.1
# Bags are weighed to a few percent and a scale reads to one percent: a larger relative difference
# means that one of both is wrong.
GROSS_ERROR_SHARE = 0.25
# Absolute error of both, kg: zero of the scale on a slope, material that fell next to the hopper.
SCALE_ERROR_KG = 5.0


class RefillWatch:
    """Recognises a refill. `seen_kg` is the mass added since the machine stopped; None without a
    refill."""

    def __init__(self) -> None:
        self.seen_kg: float | None = None
        self.is_moving = False
        # True after work was seen: only then is it certain that no refill preceded the watch.
        self._worked = False
        self._window: deque[tuple[float, float]] = deque()
        # Mass before the refill, kg.
        self._level_kg: float | None = None

    def add_row(self, row: LogRow) -> None:
        """Add a row of the run. Work, movement or a silent scale restarts the recognition."""
        self.is_moving = (row.speed_used_mps or 0.0) > MAX_STANDING_SPEED_MPS
        if row.hopper_kg is None or row.state == "working" or self.is_moving:
            self._window.clear()
            self._level_kg = None
            if row.state == "working":
                self.seen_kg, self._worked = None, True
            return
        # Time that runs backwards belongs to another log.
        if self._window and row.time_s < self._window[-1][0]:
            self._window.clear()
        self._window.append((row.time_s, row.hopper_kg))
        while row.time_s - self._window[0][0] > SETTLE_TIME_S:
            self._window.popleft()
        masses = [kg for _time, kg in self._window]
        if (
            # A window of less than 80 % of the settling time has too few readings for a decision.
            row.time_s - self._window[0][0] < 0.8 * SETTLE_TIME_S
            or max(masses) - min(masses) > SETTLE_RANGE_KG
        ):
            return
        level_kg = sum(masses) / len(masses)
        if self._level_kg is None or level_kg < self._level_kg:
            # The lowest settled mass since the stop is the level before the refill: material may
            # still flow out.
            self._level_kg = level_kg
        elif level_kg - self._level_kg > MIN_RISE_KG:
            self.seen_kg = round(level_kg - self._level_kg, 1)

    @property
    def before_kg(self) -> float | None:
        """Mass in the hopper to which nothing was added since the machine worked, kg; None where
        unknown."""
        return self._level_kg if self._worked and self.seen_kg is None else None

    def end_refill(self) -> None:
        """Restart the recognition, because the refill was recorded or rejected."""
        self.seen_kg = None
        self._level_kg = None
        self._window.clear()


def explain_refill_doubt(
    filled_kg: float, watch: RefillWatch, hopper_kg: float | None, full_kg: float, unit: Unit
) -> str:
    """Return why a typed refill is doubtful, in words; "" where it is plausible.

    Parameters
    ----------
    filled_kg
        Typed mass, kg.
    watch
        Recognition by the scale.
    hopper_kg
        Present reading of the scale, kg.
    full_kg
        Capacity of the hopper, kg.
    unit
        Unit of the text.
    """
    if watch.seen_kg is not None:
        if abs(filled_kg - watch.seen_kg) <= max(SCALE_ERROR_KG, GROSS_ERROR_SHARE * watch.seen_kg):
            return ""
        return _("The scale saw {seen} filled in.").format(
            seen=unit.format_with_name(watch.seen_kg)
        )
    if watch.is_moving:
        return _("The machine moves: is it being filled?")
    # A reading that includes the refill already is confirmed by the operator.
    level_kg = hopper_kg if watch.before_kg is None else watch.before_kg
    if level_kg is None or level_kg + filled_kg <= full_kg + SCALE_ERROR_KG:
        return ""
    return _("The scale says {now} are in the hopper: {room} more fit.").format(
        now=unit.format_with_name(level_kg),
        room=unit.format_with_name(max(0.0, full_kg - level_kg)),
    )

"""Predicts how orders change the dose, and decides whether the operator is asked first. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from topdress.console.app.typed_number import format_number
from topdress.console.app.undo_stack import find_ordered_source
from topdress.console.app.units import Units
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import Do, Order, TargetSource

# Largest change, as a share of the former dose, that needs no question. The nudge has the same
# limit in its own dialog.
MAX_UNASKED_CHANGE_SHARE = 0.3
# Orders that change the dose.
DOSE_ORDERS = frozenset({Do.SOURCE, Do.MANUAL_RATE, Do.NUDGE})
# Products of rates and nudges have rounding errors: with this slack 130 after 100 counts as 30 %.
_ROUNDING_SLACK = 1e-9


class DoseChange(NamedTuple):
    """Holds the dose before and after some orders, kg/ha, including the nudge. None means that the
    dose is unknown or is given per plant."""

    before_kg_ha: float | None
    after_kg_ha: float | None
    # Nudge contained in the dose after.
    nudge_percent: float = 0.0

    @property
    def is_large(self) -> bool:
        """Whether the operator is asked. An unknown change counts as large."""
        before, after = self.before_kg_ha, self.after_kg_ha
        if before is None or after is None:
            return True
        return abs(after - before) > (MAX_UNASKED_CHANGE_SHARE + _ROUNDING_SLACK) * before

    def format_question(self, units: Units) -> str:
        """Return the title of the question about this change."""
        return _("Change the dose from {before} to {after}?").format(
            before=self._format_rate(units, self.before_kg_ha),
            after=self._format_rate(units, self.after_kg_ha),
        )

    def format_change(self, units: Units) -> str:
        """Return the dose before and after in one line, with the relative change."""
        before, after = self.before_kg_ha, self.after_kg_ha
        share = "" if not before or after is None else f" ({100.0 * (after / before - 1.0):+.0f} %)"
        nudge = (
            _(", with the nudge of {percent} %").format(percent=f"{self.nudge_percent:+.0f}")
            if self.nudge_percent
            else ""
        )
        return (
            _("The dose here: {before} before, {after} after").format(
                before=self._format_rate(units, before), after=self._format_rate(units, after)
            )
            + share
            + nudge
        )

    @staticmethod
    def _format_rate(units: Units, rate_kg_ha: float | None) -> str:
        unit = units.rate
        return (
            "--"
            if rate_kg_ha is None
            else f"{format_number(round(rate_kg_ha * unit.per_si, 1))} {unit.name}"
        )


def predict_dose_change(frame: Frame | None, orders: Sequence[Order]) -> DoseChange | None:
    """Predict how orders change the dose at the machine's position.

    Parameters
    ----------
    frame
        Newest frame, or None before the first frame.
    orders
        Orders that are sent together.

    Returns
    -------
    DoseChange or None
        None where the orders leave the dose unchanged or no frame has arrived. The nudge dialog
        itself shows the effect on single doses.
    """
    dose_orders = {order.do: order.value for order in orders if order.do in DOSE_ORDERS}
    if frame is None or not dose_orders:
        return None
    nudge, source_before = frame.row.nudge_percent or 0.0, find_ordered_source(frame)
    source = str(dose_orders.get(Do.SOURCE, source_before))
    percent = float(dose_orders.get(Do.NUDGE, nudge) or 0.0)
    before, after = find_source_rate(frame, source_before), find_source_rate(frame, source)
    # A new manual rate changes the dose only while the manual rate is the source.
    if source == TargetSource.MANUAL and Do.MANUAL_RATE in dose_orders:
        after = float(dose_orders[Do.MANUAL_RATE] or 0.0)
    elif source == source_before and (after is None or percent == nudge):
        return None
    return DoseChange(_apply_nudge(before, nudge), _apply_nudge(after, percent), percent)


def find_source_rate(frame: Frame, source: str) -> float | None:
    """Return the rate of a target source at this position, kg/ha, without the nudge; None where
    unknown.

    A worker of an older version reports no rates of sources: then only the manual rate and the
    present rate are known.
    """
    rates = dict(zip(frame.sources, frame.source_rates, strict=False))
    if source in rates:
        return rates[source]
    if source == TargetSource.MANUAL:
        return frame.manual_rate_kg_ha
    # The logged target contains the nudge, which is divided out here.
    planned = frame.row.target_rate_kg_ha if source == find_ordered_source(frame) else None
    return None if planned is None else planned / (1.0 + (frame.row.nudge_percent or 0.0) / 100.0)


def _apply_nudge(rate_kg_ha: float | None, percent: float) -> float | None:
    return None if rate_kg_ha is None else rate_kg_ha * (1.0 + percent / 100.0)

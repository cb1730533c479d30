"""What orders make of the dose: before, after, and whether that is asked. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from topdress.console.app.typed_number import format_number
from topdress.console.app.undo import find_ordered_source
from topdress.console.app.units import Units
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import Do, Order, TargetSource

# Share of the dose before. The nudge goes as far in one question of its own.
UNASKED_SHARE = 0.3
DOSE_ORDERS = frozenset({Do.SOURCE, Do.MANUAL_RATE, Do.NUDGE})
# of the products of rates and nudges, so that 130 for 100 is no more than 30 %
_ROUNDING_SLACK = 1e-9


class DoseChange(NamedTuple):
    """Holds the dose before and after some orders, kg/ha, nudge included; None: not known, or
    single doses."""

    before_kg_ha: float | None
    after_kg_ha: float | None
    nudge_percent: float = 0.0  # of the dose after

    @property
    def is_large(self) -> bool:
        """Whether it is asked: also where nobody knows how large it is."""
        before, after = self.before_kg_ha, self.after_kg_ha
        if before is None or after is None:
            return True
        return abs(after - before) > (UNASKED_SHARE + _ROUNDING_SLACK) * before

    def format_question(self, units: Units) -> str:
        """The title of a question about it."""
        return _("Change the dose from {before} to {after}?").format(
            before=self._format_rate(units, self.before_kg_ha),
            after=self._format_rate(units, self.after_kg_ha),
        )

    def format_change(self, units: Units) -> str:
        """Before and after in one line, with the share by which it grows or falls."""
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
    """The change of dose by these orders at the machine's place; None where they leave it as it is,
    or where no frame has come yet. The effect of a nudge on single doses is in its own question."""
    dose_orders = {order.do: order.value for order in orders if order.do in DOSE_ORDERS}
    if frame is None or not dose_orders:
        return None
    nudge, source_before = frame.row.nudge_percent or 0.0, find_ordered_source(frame)
    source = str(dose_orders.get(Do.SOURCE, source_before))
    percent = float(dose_orders.get(Do.NUDGE, nudge) or 0.0)
    before, after = find_source_rate(frame, source_before), find_source_rate(frame, source)
    if source == TargetSource.MANUAL and Do.MANUAL_RATE in dose_orders:
        after = float(dose_orders[Do.MANUAL_RATE] or 0.0)
    elif source == source_before and (after is None or percent == nudge):
        return None
    return DoseChange(_apply_nudge(before, nudge), _apply_nudge(after, percent), percent)


def find_source_rate(frame: Frame, source: str) -> float | None:
    """Rate of a source of the target here, kg/ha, without the nudge; None where it is not known.
    With a worker that does not report it: the manual rate, and the present one."""
    rates = dict(zip(frame.sources, frame.source_rates, strict=False))
    if source in rates:
        return rates[source]
    if source == TargetSource.MANUAL:
        return frame.manual_rate_kg_ha
    planned = frame.row.target_rate_kg_ha if source == find_ordered_source(frame) else None
    return None if planned is None else planned / (1.0 + (frame.row.nudge_percent or 0.0) / 100.0)


def _apply_nudge(rate_kg_ha: float | None, percent: float) -> float | None:
    return None if rate_kg_ha is None else rate_kg_ha * (1.0 + percent / 100.0)

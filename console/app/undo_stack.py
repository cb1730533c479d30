"""Records changes that can be undone, with one key and one question. A table declares which order
reverses each order, or why none does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from topdress.console.app.order_words import format_order
from topdress.console.app.typed_number import format_with_unit
from topdress.console.app.units import Units
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.agronomy.reference_strips import StripMean, parse_strip
from topdress.control.orders import Do, Order, TargetSource

# Changes that stay undoable; an operator remembers few.
MAX_UNDOABLE_CHANGES = 20
# Orders that change nothing reversible, each with the reason. A test requires every order in one of
# the two tables.
WHY_NOT_UNDOABLE = MappingProxyType(
    {
        Do.READY: "a state: HOLD and STOP leave it",
        Do.START: "a state: HOLD and STOP leave it",
        Do.HOLD: "a state: START leaves it",
        Do.STOP: "a state: READY leaves it",
        Do.CALIBRATE: "while a button is down",
        Do.RELEASE: "while a button is down",
        Do.CALIBRATE_SHAFT: "ends with the run on the bench",
        Do.CALIBRATE_OPENING: "ends with the run on the bench",
        Do.ACKNOWLEDGE: "what was read was read",
        Do.MARK: "a line of the log",
        Do.REFILL_BACK: "is itself what takes a refill back",
        Do.DOSE_ERROR: "a measurement: the next one corrects it",
    }
)


class UndoableChange(NamedTuple):
    """Holds a change. `what` words the state after undoing ("strategy opening first"), `back`
    undoes the change, `orders` are the reversing orders."""

    what: str
    back: Callable[[], None]
    orders: tuple[Order, ...] = ()


class UndoStack:
    """Holds the changes, newest last. Changes of another run are removed with the run."""

    def __init__(self) -> None:
        self._changes: list[UndoableChange] = []

    def add_change(self, change: UndoableChange) -> None:
        """Add a change."""
        self._changes = [*self._changes[1 - MAX_UNDOABLE_CHANGES :], change]

    @property
    def newest(self) -> UndoableChange | None:
        """Newest change, or None."""
        return self._changes[-1] if self._changes else None

    def pop_newest(self) -> UndoableChange | None:
        """Remove the newest change and return it."""
        return self._changes.pop() if self._changes else None

    def forget_changes(self) -> None:
        """Remove all changes."""
        self._changes.clear()


def reverse_orders(orders: Sequence[Order], before: Frame | None) -> tuple[Order, ...]:
    """Return the orders that reverse orders, last first, from the frame before them; () where
    nothing needs reversing."""
    found = (
        []
        if before is None
        else [
            one
            for order in reversed(orders)
            if order.do in _REVERSERS
            for one in _REVERSERS[order.do](before, order)
        ]
    )
    # An order that equals the given order would change nothing.
    return tuple(one for one in found if one not in orders)


def describe_undo(orders: Sequence[Order], units: Units) -> str:
    """Return the state after undoing, in words."""
    return ", ".join(
        _("without the refill of {mass}").format(
            mass=format_with_unit(units.mass, float(one.value or 0.0))
        )
        if one.do is Do.REFILL_BACK
        else format_order(one.do, one.value, units)
        for one in orders
    )


def find_ordered_source(frame: Frame | None) -> str:
    """Return the ordered target source; "" where unknown. A worker of an older version reports it
    in its row only, where the index map replaces the canopy heads."""
    if frame is None:
        return ""
    # The ordered source differs from the active one while its sensors are silent.
    now = frame.ordered_source or frame.row.target_source or ""
    return TargetSource.CANOPY.value if now == TargetSource.INDEX_MAP else now


def _make_known_order(do: Do, value: str | float | bool | None) -> tuple[Order, ...]:
    """Return the order with a value, or () for an unknown value."""
    return () if value is None or value == "" else (Order(do, value),)


def _reverse_section_order(frame: Frame, order: Order) -> tuple[Order, ...]:
    """Return the orders that restore the state of the named sections."""
    # The value has the form "3 off" or "all auto".
    number = str(order.value).partition(" ")[0]
    return tuple(
        Order(Do.SECTION, f"{k} {'off' if one.why == 'hand' else 'auto'}")
        for k, one in enumerate(frame.sections, start=1)
        if number == str(k) or (number == "all" and one.why == "hand")
    )


def _reverse_strip_order(frame: Frame, order: Order) -> tuple[Order, ...]:
    """Return the order that restores the former value of a strip."""
    # The frame before has the former value of both strips.
    strip = parse_strip(order.value)
    return (
        ()
        if strip is None
        else (
            Order(Do.STRIP, StripMean(strip.which, getattr(frame.strips, strip.which)).event_text),
        )
    )


_REVERSERS: Mapping[Do, Callable[[Frame, Order], tuple[Order, ...]]] = MappingProxyType(
    {
        Do.STRATEGY: lambda frame, order: _make_known_order(order.do, frame.row.strategy),
        Do.SOURCE: lambda frame, order: _make_known_order(order.do, find_ordered_source(frame)),
        Do.NUDGE: lambda frame, order: _make_known_order(order.do, frame.row.nudge_percent),
        Do.MANUAL_RATE: lambda frame, order: _make_known_order(order.do, frame.manual_rate_kg_ha),
        Do.REFILL: lambda frame, order: _make_known_order(Do.REFILL_BACK, order.value),
        Do.ALLOW_REVERSE: lambda frame, order: _make_known_order(order.do, frame.allow.reverse),
        Do.ALLOW_OUTSIDE: lambda frame, order: _make_known_order(order.do, frame.allow.outside),
        Do.ALLOW_MAP_ELSEWHERE: lambda frame, order: _make_known_order(
            order.do, frame.allow.map_elsewhere
        ),
        Do.ALLOW_NO_WHEEL: lambda frame, order: _make_known_order(order.do, frame.allow.no_wheel),
        Do.GO_ON_UNLOGGED: lambda frame, order: _make_known_order(order.do, frame.allow.unlogged),
        Do.FLOW_TRIM: lambda frame, order: _make_known_order(order.do, frame.flow_trim_on),
        Do.LOOK_AHEAD: lambda frame, order: _make_known_order(order.do, frame.look_ahead),
        Do.NO_DOUBLE: lambda frame, order: _make_known_order(order.do, frame.no_double),
        Do.SECTION: _reverse_section_order,
        Do.STRIP: _reverse_strip_order,
    }
)

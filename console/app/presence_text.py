"""Words the presence of other consoles at the machine: who is attached, comes, leaves or gave an
order. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from topdress.console.app.order_words import format_order
from topdress.console.app.panel_views import format_duration, format_local_time
from topdress.console.app.units import METRIC
from topdress.console.attached_consoles import AttachedConsole, ExecutedOrder
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.orders import State


class PresenceView(NamedTuple):
    """Holds the row about other consoles. `order` is the latest order, by another console, or by
    this console while others are attached; `others` names them."""

    order: str
    others: str


def list_others(frame: Frame, own: str) -> tuple[AttachedConsole, ...]:
    """Return all attached consoles except this console."""
    return tuple(one for one in frame.attached if one.name != own)


def make_presence_view(frame: Frame | None, own: str, utc_offset_s: float) -> PresenceView | None:
    """Return the row below the alarms; None while this console is alone and gave the latest order
    itself.

    Parameters
    ----------
    frame
        Newest frame, or None.
    own
        Name of this console.
    utc_offset_s
        Local time minus UTC, s.
    """
    if frame is None:
        return None
    rest = list_others(frame, own)
    # The frame lists the latest orders, oldest first.
    latest = frame.ordered[-1] if frame.ordered else None
    if not rest and (latest is None or latest.name == own):
        return None
    return PresenceView(
        "" if latest is None else describe_given_order(latest, frame, own, utc_offset_s),
        _("at this machine: {names}").format(
            names=", ".join([_("this one"), *map(format_short_name, rest)])
        ),
    )


def format_short_name(one: AttachedConsole) -> str:
    """Return the name of a console, marked if it cannot give orders."""
    return one.name if one.orders else _("{name} (looks only)").format(name=one.name)


def describe_kind(one: AttachedConsole) -> str:
    """Return kind and rights of a console, and whether it keeps the machine working."""
    kind = _("tablet") if one.tablet else _("console")
    # The rights matter more than the kind of device.
    if not one.orders:
        return _("{kind}, looks only").format(kind=kind)
    if one.keeps:
        return _("{kind}, keeps the machine working").format(kind=kind)
    if one.tablet:
        return _("{kind}, orders, does not keep the machine working").format(kind=kind)
    return _("{kind}, silent: does not keep the machine working").format(kind=kind)


def describe_given_order(one: ExecutedOrder, frame: Frame, own: str, utc_offset_s: float) -> str:
    """Return an order with its console and time of day."""
    back_s = max(0.0, frame.row.time_s - one.time_s)
    when = format_local_time(frame.row.utc, utc_offset_s, back_s) or _("{duration} ago").format(
        duration=format_duration(back_s)
    )
    return _("{order} by {name}, {when}").format(
        # Orders are worded in SI units for all consoles, whose units may differ.
        order=format_order(one.do, one.value, METRIC),
        name=_("this console") if one.name == own else one.name,
        when=when,
    )


def describe_presence_changes(before: Frame, now: Frame, own: str) -> str:
    """Return what other consoles did between two frames, in one line; "" for nothing."""
    # Names identify consoles; the worker makes them unique.
    was, here = ({one.name: one for one in list_others(frame, own)} for frame in (before, now))
    lines = [
        _("{name} has joined ({kind})").format(name=one.name, kind=describe_kind(one))
        for name, one in here.items()
        if name not in was
    ]
    lines += [
        _("{name} has left").format(name=name) + _describe_consequence(one, now)
        for name, one in was.items()
        if name not in here
    ]
    lines += [
        _("{name} is silent").format(name=name) + _describe_consequence(was[name], now)
        for name, one in here.items()
        # A console that falls silent is still connected but no longer alive.
        if name in was and was[name].keeps and not one.keeps
    ]
    # An order that was in the former frame is no news.
    known = set(before.ordered)
    lines += [
        _("{name}: {order}").format(name=one.name, order=format_order(one.do, one.value, METRIC))
        for one in now.ordered
        if one not in known and one.name != own
    ]
    return ";  ".join(lines)


def _describe_consequence(one: AttachedConsole, now: Frame) -> str:
    """Return the consequence of a lost console for a working machine."""
    if not one.keeps or now.row.state != State.WORKING:
        return ""
    # Another living console keeps the machine working.
    keep = [other.name for other in now.attached if other.keeps and other.name != one.name]
    if keep:
        return _(": the machine goes on, {names} keeps it working").format(names=", ".join(keep))
    return _(": no console is left, the machine is held after 2 s")


def describe_leaving(frame: Frame, own: str, keeps_working: bool) -> str:
    """Return the consequence for a working machine if this console is closed."""
    # A worker of an older version sends the number of consoles only.
    if not frame.attached:
        if frame.consoles - keeps_working > 0:
            return _(
                "The machine works, and goes on: another console is open and keeps it working."
            )
        return (
            _("The machine works: it is held after 2 s without console.")
            if frame.consoles
            else _("The machine works: it is held after 2 s, unless another console is open.")
        )
    rest = list_others(frame, own)
    keep = [one.name for one in rest if one.keeps]
    if keep:
        return _("The machine works, and goes on: {names} keeps it working.").format(
            names=", ".join(keep)
        )
    text = _("The machine works: it is held after 2 s without console.")
    # View-only consoles stay attached but do not keep the machine working.
    stay = ", ".join(map(format_short_name, rest))
    return (
        f"{text} {_('None of those that stay keeps it working: {names}.').format(names=stay)}"
        if stay
        else text
    )


def describe_everyone(frame: Frame, own: str, utc_offset_s: float) -> str:
    """Return all consoles and the latest orders, for a dialog."""
    lines = [
        f"{one.name}{' ' + _('(this one)') if one.name == own else ''}:  {describe_kind(one)}"
        for one in frame.attached
    ]
    orders = [
        describe_given_order(one, frame, own, utc_offset_s) for one in reversed(frame.ordered)
    ]
    return "\n".join([*lines, "", _("Latest orders:") if orders else _("No orders yet."), *orders])


def describe_arrival(frame: Frame, own: str, utc_offset_s: float) -> Sequence[str]:
    """Return the consoles that a newly attached console finds, and the latest order."""
    rest = list_others(frame, own)
    found = (
        [
            _("Also attached: {names}.").format(
                names="; ".join(f"{one.name} ({describe_kind(one)})" for one in rest)
            )
        ]
        if rest
        else []
    )
    if frame.ordered:
        found.append(
            _("Latest order: {order}.").format(
                order=describe_given_order(frame.ordered[-1], frame, own, utc_offset_s)
            )
        )
    return found

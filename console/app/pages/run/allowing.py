"""What the operator may allow, with what is allowed now: each line of the dialog turns one into its opposite."""
from __future__ import annotations

from console.app.dialogs import Choice
from console.frame import Frame
from console.locale import _
from control.orders import Do
from control.safety import Allowances

SECTIONS = "sections"       # not an order: asks which section


def allow_choices(frame: Frame | None) -> tuple[Choice, ...]:
    """Values are an order and its value as text, `allow_outside:True`. A second dose is allowed by switching off the
    guard against it."""
    allow, no_double = (frame.allow, frame.no_double) if frame is not None else (Allowances(), True)
    found = ((Do.ALLOW_REVERSE, _("flow while reversing"), allow.reverse),
             (Do.ALLOW_OUTSIDE, _("flow outside the field"), allow.outside),
             (Do.GO_ON_UNLOGGED, _("work without a log"), allow.unlogged),
             (Do.NO_DOUBLE, _("a second dose on done ground"), not no_double),
             (Do.ALLOW_MAP_ELSEWHERE, _("the outside rate of a map that lies elsewhere"), allow.map_elsewhere))
    sections = (Choice(SECTIONS, _("sections by hand: close or give back ...")),) if frame and frame.sections else ()
    return (*_orders(found), *sections)


def _orders(found: tuple[tuple[Do, str, bool], ...]) -> tuple[Choice, ...]:
    return tuple(Choice(f"{do.value}:{allowed if do is Do.NO_DOUBLE else not allowed}", _line(what, allowed))
                 for do, what, allowed in found)


def _line(what: str, allowed: bool) -> str:
    said = _("{what}. Now: ALLOWED. Forbid it?") if allowed else _("{what}. Now: not allowed. Allow it?")
    return said.format(what=what)

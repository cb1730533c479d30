"""What the operator may allow, with what is allowed now: each line of the dialog turns one into its opposite."""
from __future__ import annotations

from typing import NamedTuple

from console.app.dialogs import Choice
from console.frame import Frame
from console.locale import _
from control.orders import Do
from control.safety import Allowances

SECTIONS = "sections"       # not an order: asks which section


class Allowance(NamedTuple):
    """One thing that may be allowed, in words; whether it is now; the order that turns it into its opposite."""

    words: str
    allowed: bool
    do: Do
    to: bool


def allowances(frame: Frame | None) -> dict[str, Allowance]:
    """By the name of the order. A second dose is allowed by switching off the guard against it."""
    allow, no_double = (frame.allow, frame.no_double) if frame is not None else (Allowances(), True)
    found = ((Do.ALLOW_REVERSE, _("flow while reversing"), allow.reverse),
             (Do.ALLOW_OUTSIDE, _("flow outside the field"), allow.outside),
             (Do.ALLOW_NO_WHEEL, _("work by GNSS alone where the wheel sensor is dead"), allow.no_wheel),
             (Do.GO_ON_UNLOGGED, _("work without a log"), allow.unlogged),
             (Do.NO_DOUBLE, _("a second dose on done ground"), not no_double),
             (Do.ALLOW_MAP_ELSEWHERE, _("spreading by a map that lies somewhere else"), allow.map_elsewhere))
    return {do.value: Allowance(what, allowed, do, allowed if do is Do.NO_DOUBLE else not allowed)
            for do, what, allowed in found}


def allow_choices(frame: Frame | None) -> tuple[Choice, ...]:
    """A line for each; the value is its name in `allowances`, or `SECTIONS`."""
    sections = (Choice(SECTIONS, _("sections by hand: close or give back ...")),) if frame and frame.sections else ()
    return (*(Choice(name, _line(one.words, one.allowed)) for name, one in allowances(frame).items()), *sections)


def _line(what: str, allowed: bool) -> str:
    said = _("forbid again (now allowed): {what}") if allowed else _("allow: {what}")
    return said.format(what=what)

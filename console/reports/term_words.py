"""A term in one sentence, the same in terminal, report and page: what changes, by how much, over what, seen where."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from console.locale import N_, _
from console.reports.numbers import MINUS, number
from control.machine.machine import CATALOGUE, Change
from control.machine.term_sums import not_compensated, partly_compensated
from control.machine.terms import STAGE_OF, VARIABLES, Acts, Form, Term

WHAT = {"shaft": N_("Shaft speed"), "gate": N_("Opening"), "flow": N_("Flow"), "scale": N_("Scale reading"),
        "speed": N_("Wheel speed")}
VARIABLE = {"shaft_rpm": N_("shaft speed"), "opening_mm": N_("opening"), "hopper_kg": N_("hopper level"),
            "pitch_deg": N_("pitch"), "roll_deg": N_("roll"), "supply_v": N_("supply voltage"),
            "speed_mps": N_("travel speed"), "heading_deg": N_("heading"), "time_s": N_("time"),
            "shaft_angle_deg": N_("shaft angle")}
WHY_NOT = {"it holds for a span of one run": N_("it holds for a span of one run"),
           "control does not know the shaft's angle when what it commands comes to pass":
               N_("control does not know the shaft's angle when what it commands comes to pass"),
           "control does not read the wheel through it": N_("control does not read the wheel through it"),
           "with the speed of now, not with that at landing": N_("with the speed of now, not with that at landing"),
           "with the time since this run began": N_("with the time since this run began")}
FORGETS = 0.2               # of its size: what a memory leaves when nothing changes any more


def sentence(plain: Mapping[str, Any]) -> str:
    """Of a term as plain data (`result.TermFound.term`)."""
    term = Term.model_validate(plain)
    said = _SAID[term.form](term)
    ranges = [_("{variable} between {low} and {high} {unit}").format(
        variable=variable_name(one.name), low=_n(one.valid[0]), high=_n(one.valid[1]), unit=one.unit_shown)
        for one in term.over if one.valid is not None]
    if len(ranges) == 1 and term.over[0].valid is not None:
        low, high = term.over[0].valid
        said += "; " + _("seen between {low} and {high} {unit}").format(low=_n(low), high=_n(high),
                                                                        unit=term.over[0].unit_shown).rstrip()
    elif ranges:
        said += "; " + _("seen with {ranges}").format(ranges=", ".join(ranges))
    return said


def compensation(plain: Mapping[str, Any]) -> str:
    """What control does about a term once the machine file has it."""
    term = Term.model_validate(plain)
    if why := not_compensated(term):
        return _("Control cannot correct for it: {why}").format(why=_(WHY_NOT.get(why, why)))
    if partly := partly_compensated(term):
        return _("Control corrects for it {how}").format(how=_(WHY_NOT.get(partly, partly)))
    return _("Control corrects for it")


def variable_name(name: str) -> str:
    """A variable in words; a further column by its own name."""
    return _(VARIABLE[name]) if name in VARIABLE else name


def _n(value: float, digits: int = 2) -> str:
    text = number(value, digits).replace(MINUS, "-")
    return text.rstrip("0").rstrip(".") if "." in text else text


def _signed(value: float, unit: str) -> str:
    return f"{'+' if value > 0.0 else ''}{_n(value)} {unit}"


def _words(term: Term) -> dict[str, str]:
    first = term.over[0]
    found = {"what": _(WHAT[STAGE_OF[term.acts_on]]), "x": variable_name(first.name),
             "per": first.unit_shown or _("unit")}
    if term.acts_on is Acts.SCALE_KG_MIN:
        found["what"] = _("Scale drift")
    return found


def _slope(term: Term) -> str:
    size = term.coefficients["slope"]
    text = _("{what} rises by {size} {unit} for each {per} of {x}") if size > 0.0 else _(
        "{what} falls by {size} {unit} for each {per} of {x}")
    return text.format(size=_n(abs(size)), unit=term.unit, **_words(term))


def _bend(term: Term) -> str:
    c = term.coefficients
    vertex = c.get("at", 0.0) - 0.5 * c.get("slope", 0.0) / c["bend"] if c["bend"] else 0.0
    text = _("{what} rises by {size} {unit} for each ({per})2 of {x} away from {at} {per}") if c["bend"] > 0.0 else _(
        "{what} falls by {size} {unit} for each ({per})2 of {x} away from {at} {per}")
    return text.format(size=_n(abs(c["bend"])), unit=term.unit, at=_n(vertex), **_words(term))


def _hinge(term: Term) -> str:
    c = term.coefficients
    return _("{what} changes by {below} for each {per} of {x} below {at} {per}, by {above} above").format(
        below=_signed(c.get("below", 0.0), term.unit), above=_signed(c.get("above", 0.0), term.unit),
        at=_n(c["at"]), **_words(term))


def _saturation(term: Term) -> str:
    c = term.coefficients
    whole = c["slope"] * (c["high_end"] - c["low_end"])
    if c["low_end"] == 0.0 and term.acts_on is Acts.SHAFT_RPM and term.variables == ("shaft_rpm",):
        return _("{what} is off by {size} whatever the command").format(size=_signed(whole, term.unit), **_words(term))
    return _("{what} changes by {size} for each {per} of {x} from {low} to {high} {per}, and no further").format(
        size=_signed(c["slope"], term.unit), low=_n(c["low_end"]), high=_n(c["high_end"]), **_words(term))


def _dead_zone(term: Term) -> str:
    c = term.coefficients
    return _("{what} changes by {size} for each {per} of {x} beyond {low} to {high} {per}, and not between").format(
        size=_signed(c["slope"], term.unit), low=_n(c["low_end"]), high=_n(c["high_end"]), **_words(term))


def _threshold(term: Term) -> str:
    c = term.coefficients
    return _("{what} differs by {size} where {x} is above {at} {per}").format(
        size=_signed(c.get("above", 0.0) - c.get("below", 0.0), term.unit), at=_n(c["at"]), **_words(term))


def _product(term: Term) -> str:
    c, second = term.coefficients, term.over[1]
    return _("{what} changes by {size} for each {per} of {x} from {at} times each {per2} of {y} from {at2}").format(
        size=_signed(c["slope"], term.unit), y=variable_name(second.name), per2=second.unit_shown or _("unit"),
        at=_n(c.get("at", 0.0)), at2=_n(c.get("second_at", 0.0)), **_words(term))


def _memory(term: Term) -> str:
    c = term.coefficients
    now, late = c.get("slope", 0.0), c["bend"]
    if abs(now + late) < FORGETS * max(abs(now), abs(late)):
        return _("{what} changes by {size} for each {per} by which {x} has just changed, and forgets it with a time "
                 "constant of {tau} s").format(size=_signed(now, term.unit), tau=_n(c["tau_s"]), **_words(term))
    return _("{what} follows {x} late, with a time constant of {tau} s: {size} for each {per}").format(
        size=_signed(now + late, term.unit), tau=_n(c["tau_s"]), **_words(term))


def _periodic(term: Term) -> str:
    c = term.coefficients
    size = (c.get("sine", 0.0) ** 2 + c.get("cosine", 0.0) ** 2) ** 0.5
    return _("{what} swings by {size} {unit} to both sides, {count} times a turn of {x}").format(
        size=_n(size), unit=term.unit, count=_n(c["cycles"]), **_words(term))


def _side(term: Term) -> str:
    c = term.coefficients
    size = _signed(c.get("above", 0.0) - c.get("below", 0.0), term.unit)
    if c.get("tau_s", 0.0) > 0.0:
        return _("{what} differs by {size} between {x} rising and falling").format(size=size, **_words(term))
    return _("{what} differs by {size} between both sides of {x}").format(size=size, **_words(term))


def _span(term: Term) -> str:
    c = term.coefficients
    return _("{what} is off by {size} from {begin} s to {end} s").format(
        size=_signed(c["above"], term.unit), begin=_n(c["low_end"], 4), end=_n(c["high_end"], 4), **_words(term))


def _table(term: Term) -> str:
    low, high = min(term.values), max(term.values)
    return _("{what} follows {x} in a curve of its own, from {low} to {high}").format(
        low=_signed(low, term.unit), high=_signed(high, term.unit), **_words(term))


def side_by_side(change: Change) -> list[str]:
    """Each effect and term of a machine file before and after, a line each."""
    lines = [f"  {one.id}{'' if one.member is None else f'#{one.member}'}: {one.before:.4g} -> {one.after:.4g} "
             f"{CATALOGUE[one.id].effect.unit}" for one in change.effects]
    terms = [f"  {term.id}: {_('none')} -> {sentence(term.model_dump(mode='json'))}" for term in change.terms]
    return [*lines, *terms]


_SAID: dict[Form, Callable[[Term], str]] = {
    Form.SLOPE: _slope, Form.BEND: _bend, Form.HINGE: _hinge, Form.SATURATION: _saturation,
    Form.DEAD_ZONE: _dead_zone, Form.THRESHOLD: _threshold, Form.PRODUCT: _product, Form.MEMORY: _memory,
    Form.PERIODIC: _periodic, Form.SIDE: _side, Form.SPAN: _span, Form.TABLE: _table}
_unmatched = set(VARIABLE) ^ set(VARIABLES)
if _unmatched:
    raise RuntimeError(f"variables without words, or words without a variable: {', '.join(sorted(_unmatched))}")

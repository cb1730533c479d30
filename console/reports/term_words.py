"""How is a term described in one sentence, for terminal, report and page? It has quantity, change,
variable, and the observing sensor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from topdress.console.locale import N_, _
from topdress.console.reports.number_text import format_short
from topdress.control.machine.machine import CATALOGUE, Change
from topdress.control.machine.term_form import FORMS, SHAFT_ANGLE
from topdress.control.machine.term_sums import explain_not_compensated, explain_partly_compensated
from topdress.control.machine.terms import TARGET_STAGES, Term, TermTarget, parse_term
from topdress.control.signals import SIGNALS
from topdress.drivers.plugins import EffectPlugin, list_effects

# Smallest change per unit of a variable that is shown as such.
MIN_SHOWN_CHANGE = 1e-3

STAGE_NAMES = {
    "shaft": N_("Shaft speed"),
    "gate": N_("Opening"),
    "flow": N_("Flow"),
    "scale": N_("Scale reading"),
    "speed": N_("Wheel speed"),
}
VARIABLE_NAMES = {
    **{name: one.term_label for name, one in SIGNALS.items() if one.term_label},
    SHAFT_ANGLE: N_("shaft angle"),
}
REFUSAL_REASONS = (
    # These reasons are those of the machine model.
    N_("it holds for a span of one run"),
    N_("control does not know the shaft's angle when what it commands comes to pass"),
    N_("control does not read the wheel through it"),
    N_("with the speed of now, not with that at landing"),
    N_("with the time since this run began"),
)


def describe_term(plain: Mapping[str, Any]) -> str:
    """Returns a term, given as plain data (`result.TermFound.term`), in one sentence."""
    term = Term.model_validate(plain)
    said = _describe_form(term)
    ranges = [
        _("{variable} between {low} and {high} {unit}").format(
            variable=name_variable(one.name),
            low=format_short(one.valid[0], 2),
            high=format_short(one.valid[1], 2),
            unit=one.displayed_unit,
        )
        for one in term.over
        if one.valid is not None
    ]
    if len(ranges) == 1 and term.over[0].valid is not None:
        low, high = term.over[0].valid
        said += (
            "; "
            + _("seen between {low} and {high} {unit}")
            .format(
                low=format_short(low, 2),
                high=format_short(high, 2),
                unit=term.over[0].displayed_unit,
            )
            .rstrip()
        )
    elif ranges:
        said += "; " + _("seen with {ranges}").format(ranges=", ".join(ranges))
    return said + "".join(
        f" ({one.title}: {one.advice})"
        for one in list_effects().values()
        if _is_plugin_term(term, one)
    )


def _is_plugin_term(term: Term, plugin: EffectPlugin) -> bool:
    try:
        other = parse_term(plugin.term.format(size="1"), Term.model_validate)
    # Another package may define a term that does not exist here.
    except ValueError:
        return False
    return (other.acts_on, other.form, other.variable_names) == (
        term.acts_on,
        term.form,
        term.variable_names,
    )


def describe_compensation(plain: Mapping[str, Any]) -> str:
    """Returns how control compensates a term once the machine file has it."""
    term = Term.model_validate(plain)
    if why := explain_not_compensated(term):
        return _("Control cannot correct for it: {why}").format(why=_(why))
    if partly := explain_partly_compensated(term):
        return _("Control corrects for it {how}").format(how=_(partly))
    return _("Control corrects for it")


def name_variable(name: str) -> str:
    """Returns a variable in words; an extra column by its own name."""
    return _(VARIABLE_NAMES[name]) if name in VARIABLE_NAMES else name


def _describe_form(term: Term) -> str:
    form, first, last = FORMS[term.form], term.over[0], term.over[-1]
    words = form.find_numbers(term)
    # The change is given for a number of units that avoids a displayed zero, because one gram of
    # load changes little.
    sizes = [
        abs(value)
        for value in (*words.changes.values(), words.numbers.get("size", 0.0))
        if value != 0.0
    ]
    of = (
        10.0 ** max(0.0, math.ceil(math.log10(MIN_SHOWN_CHANGE / max(sizes))))
        if sizes and form.each_unit
        else 1.0
    )
    per = first.displayed_unit or _("unit")
    what = (
        N_("Scale drift")
        if term.acts_on is TermTarget.SCALE_KG_MIN
        else STAGE_NAMES[TARGET_STAGES[term.acts_on]]
    )
    return _(form.sentences[words.which]).format(
        what=_(what),
        unit=term.unit,
        x=name_variable(first.name),
        per=per if of == 1.0 else f"{of:.0f} {per}",
        y=name_variable(last.name),
        per2=last.displayed_unit or _("unit"),
        **{name: _format_signed(of * value, term.unit) for name, value in words.changes.items()},
        **{
            name: format_short(of * value if name == "size" else value, 2)
            for name, value in words.numbers.items()
        },
        **{name: format_short(value, 4) for name, value in words.times_s.items()},
    )


def _format_signed(value: float, unit: str) -> str:
    return f"{'+' if value > 0.0 else ''}{format_short(value, 2)} {unit}"


def compare_side_by_side(change: Change) -> list[str]:
    """Returns each effect and term of a machine file before and after, one line each."""
    lines = [
        f"  {one.id}{'' if one.member is None else f'#{one.member}'}: {one.before:.4g} -> "
        f"{one.after:.4g} "
        f"{CATALOGUE[one.id].effect.unit}"
        for one in change.effects
    ]
    terms = [
        f"  {term.id}: {_('none')} -> {describe_term(term.model_dump(mode='json'))}"
        for term in change.terms
    ]
    return [*lines, *terms]

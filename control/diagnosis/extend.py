"""Extends a machine file by the results of a diagnosis, so that they are simulated, predicted and
compensated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from topdress.control.diagnosis.dataframe_input import load_machine
from topdress.control.diagnosis.effects import EFFECT_ROWS, find_size_range
from topdress.control.machine.effect import LONGEST_ANSWER
from topdress.control.machine.fault_injection import InjectedEffect
from topdress.control.machine.history import append_history
from topdress.control.machine.machine import (
    CATALOGUE,
    Adopted,
    Limits,
    Machine,
    add_effect,
    allow_long_answers,
    find_size_bounds,
)
from topdress.control.machine.term_form import FORMS, SHAFT_ANGLE
from topdress.control.machine.terms import Source, Term

from .result import UNKNOWN, Cause, Diagnosis, TermFound


def extend(
    machine: Machine | str,
    diagnosis: Diagnosis,
    *,
    date: str = "",
    sha256: str = "",
    valid: Mapping[str, tuple[float, float]] | None = None,
) -> Machine:
    """Return the machine with the named causes and terms adopted, so that they are simulated,
    predicted and compensated.

    The terms beyond the catalogue are adopted as well, each with the data of its origin. Effects
    that begin, grow or end within a run (a blocked outlet, a stall) are repaired, not modelled:
    they are left out, as are temporary terms. A drive that was fitted as a whole is adopted as a
    whole, in place of its causes.

    Parameters
    ----------
    machine
        The machine of the diagnosis, or its file or shipped name.
    diagnosis
        The result; its causes' sizes are added to the machine's own effects.
    date, sha256
        Entries of the file: the day, and the checksum of the data.
    valid
        Range by recorded variable in which the extension is valid; default: the ranges that the
        data excited.

    Returns
    -------
    Machine
        A copy of `machine` with the causes and terms.

    Raises
    ------
    ValueError
        For a size out of the catalogue's bounds.

    Examples
    --------
    >>> from topdress.control.diagnosis.result import Cause, Diagnosis, FieldCost, Size
    >>> from topdress.control.diagnosis.result import SourceSummary
    >>> from topdress.control.machine.machine import Machine, list_effect_sizes
    >>> size, cost = Size(6.0, 5.5, 6.5, "%"), FieldCost(6.0, 0.0)
    >>> cause = Cause("flow.gain", size, None, 0.99, (), None, "Do a catch test.", cost)
    >>> data = SourceSummary("run.csv", "run", 600, 60.0, "huanghai")
    >>> found = Diagnosis(data, (), "named", (cause,), (), (), None, (), None)
    >>> list_effect_sizes(extend(Machine(), found, date="2026-07-01"))
    {'flow.gain': 6.0}
    """
    was = load_machine(machine)
    machine = allow_long_answers(was, _find_longest_answer_s(was, diagnosis))
    ranges = dict(diagnosis.excited if valid is None else valid)
    adopted = list(machine.adopted)
    for cause in list_adoptable_causes(diagnosis):
        if is_in_drive_fit(diagnosis, cause):
            continue
        assert cause.size.value is not None
        machine = add_effect(machine, cause.id, _calc_total_size(machine, cause), cause.member)
        adopted.append(
            Adopted(
                id=cause.id,
                size=cause.size.value,
                low=cause.size.low,
                high=cause.size.high,
                unit=cause.size.unit,
                member=cause.member,
                data=diagnosis.data.path,
                sha256=sha256,
                date=date,
                valid=ranges,
            )
        )
    for effect_id, size in diagnosis.fitted.sizes if diagnosis.fitted else ():
        assert size.value is not None
        machine = add_effect(machine, effect_id, _add_within_bounds(machine, effect_id, size.value))
        adopted.append(
            Adopted(
                id=effect_id,
                size=size.value,
                low=size.low,
                high=size.high,
                unit=size.unit,
                data=diagnosis.data.path,
                sha256=sha256,
                date=date,
                valid=ranges,
            )
        )
    terms = list(machine.terms)
    for found in list_adoptable_terms(diagnosis):
        source = Source(data=diagnosis.data.path, sha256=sha256, date=date)
        term = Term.model_validate(found.term)
        terms.append(
            term.model_copy(
                update={"id": find_free_id(term.id, [one.id for one in terms]), "source": source}
            )
        )
    extended = machine.model_copy(update={"adopted": tuple(adopted), "terms": tuple(terms)})
    if extended == was:
        return was
    return append_history(was, extended, data=diagnosis.data.path, sha256=sha256, date=date)


def _find_longest_answer_s(machine: Machine, diagnosis: Diagnosis) -> float:
    """Return the longest answer that the bounds of the diagnosed times must allow, s."""
    sizes = [(cause.id, cause.size) for cause in list_adoptable_causes(diagnosis)]
    sizes += list(diagnosis.fitted.sizes) if diagnosis.fitted else []
    longest_s = 0.0
    for effect_id, size in sizes:
        entry = CATALOGUE[effect_id]
        if entry.effect.scales_with == LONGEST_ANSWER and size.value is not None:
            total = getattr(getattr(machine, entry.stage), entry.field) + size.value
            share = total / (entry.high if total > 0.0 else entry.low)
            longest_s = max(longest_s, share * Limits().longest_answer_s)
    return longest_s


def find_free_id(name: str, taken: Sequence[str]) -> str:
    """Return the name, with a number where another term has the name."""
    count = 2
    free = name
    while free in taken:
        free, count = f"{name}.{count}", count + 1
    return free


def list_adoptable_terms(diagnosis: Diagnosis) -> tuple[TermFound, ...]:
    """Return the terms that a machine file may adopt."""
    return tuple(found for found in diagnosis.terms if not find_term_refusal(found))


def find_term_refusal(found: TermFound) -> str:
    """Return the reason why no machine file adopts a term; "" where one may."""
    if FORMS[found.term["form"]].one_run:
        return "it holds for a span of one run: the model stays"
    if any(variable["name"] == SHAFT_ANGLE for variable in found.term["over"]):
        return "where the shaft stands when another run begins is not known: the model stays"
    return found.refused


def list_adoptable_causes(diagnosis: Diagnosis) -> tuple[Cause, ...]:
    """Return the causes that can be modelled from the start of a run: permanent effects with a
    size."""
    return tuple(c for c in diagnosis.causes if not find_cause_refusal(c))


def is_in_drive_fit(diagnosis: Diagnosis, cause: Cause) -> bool:
    """Tell whether a cause's drive was fitted as a whole, which then includes the cause."""
    return (
        diagnosis.fitted is not None
        and diagnosis.fitted.channel == CATALOGUE[cause.id].stage
        and EFFECT_ROWS[cause.id].scanned
    )


def find_cause_refusal(cause: Cause) -> str:
    """Return the reason why no machine file adopts a cause; "" where one may."""
    if cause.grows:
        return "grew during the run: repair it, the model stays"
    if cause.onset_s is not None or CATALOGUE[cause.id].effect.onset_only:
        return "began during the run: repair it, the model stays"
    if cause.until_s is not None:
        return "ended during the run: the model stays"
    if any(rival.id == UNKNOWN for rival in cause.rivals):
        return "it may be something else: no machine file takes up what is only suspected"
    return "" if cause.size.value is not None else "its size is not known"


def check_adoptable(cause: Cause) -> None:
    """Raise ValueError for an effect of one label or one table only (its scope), which does not
    hold for the machine."""
    if cause.scope is not None:
        raise ValueError(
            f"{cause.id}: holds for {cause.scope} only, not for the machine: it is not "
            "adopted; diagnose "
            "that data by itself to adopt what it shows"
        )


def make_planted_effects(machine: Machine, diagnosis: Diagnosis) -> tuple[InjectedEffect, ...]:
    """Return the adoptable causes as effects of a simulated `machine`, added to those of its
    file."""
    return tuple(
        InjectedEffect(c.id, _calc_total_size(machine, c), 0.0, c.member)
        for c in list_adoptable_causes(diagnosis)
    )


def _calc_total_size(machine: Machine, cause: Cause) -> float:
    return _add_within_bounds(machine, cause.id, cause.size.value or 0.0)


def _add_within_bounds(machine: Machine, effect_id: str, size: float) -> float:
    """Return a size added to the machine's own size of an effect, within its bounds."""
    entry = CATALOGUE[effect_id]
    before = getattr(getattr(machine, entry.stage), entry.field) - entry.neutral
    low, high = find_size_bounds(effect_id, machine)
    return float(min(high, max(low, before + max(size, find_size_range(effect_id, machine).low))))

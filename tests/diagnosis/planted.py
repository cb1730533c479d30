"""A planted case: a log, the machine file it is held against, and what a diagnosis is to say.
One check for all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from topdress.control.diagnosis.result import UNKNOWN, Cause, Diagnosis
from topdress.control.diagnosis.runs.channels import simulate_drive_rows
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.diagnosis.runs.drives import read_whole_drives
from topdress.control.diagnosis.runs.hypothesis import list_stages, make_schedule
from topdress.control.diagnosis.runs.log import clean_run_log
from topdress.control.machine.machine import Machine
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from tests.diagnosis.logs import Columns

Question = Callable[[Diagnosis, Any], bool]


@dataclass(frozen=True, eq=False)
class Between:
    """Equal to whatever lies between two bounds."""

    low: float = -np.inf
    high: float = np.inf
    __array_ufunc__ = None  # a number of numpy's asks it

    def __eq__(self, other: object) -> bool:
        return isinstance(other, float | int) and self.low < other < self.high


def planted(
    name: str,
    log: Callable[[], Columns],
    machine: Machine | str | None = None,
    *,
    exam: bool = False,
    **said: Any,
) -> Any:
    """A row of a table of cases: parameters `log`, `machine` (the nominal one) and `said`
    (QUESTIONS)."""
    return pytest.param(log, machine or Machine(), said, id=name, marks=[pytest.mark.exam] * exam)


def found_as_planted(
    log: Callable[[], Columns], machine: Machine | str, said: Mapping[str, Any]
) -> None:
    check(diagnose_run(log(), machine), **said)


def of_causes(what: Callable[[Cause], Any]) -> Question:
    """By id, or of the only cause."""

    def holds(found: Diagnosis, expected: Any) -> bool:
        if not isinstance(expected, dict):
            return [what(cause) for cause in found.causes] == [expected]
        by_id = {cause.id: what(cause) for cause in found.causes}
        return all(by_id.get(name) == value for name, value in expected.items())

    return holds


def members(found: Diagnosis) -> set[str]:
    """Ids of causes and of their rivals."""
    return {
        name for cause in found.causes for name in (cause.id, *(rival.id for rival in cause.rivals))
    }


def forms(found: Diagnosis) -> list[tuple[str, str, list[str]]]:
    """Of each term what it acts on, its form, and over what."""
    return [
        (term["acts_on"], term["form"], sorted(v["name"] for v in term["over"]))
        for term in (one.term for one in found.terms)
    ]


# What may be asked of a diagnosis: of it and of what is expected.
QUESTIONS: dict[str, Question] = {
    "verdict": lambda found, words: found.verdict in ([words] if isinstance(words, str) else words),
    # and no others
    "names": lambda found, ids: sorted(cause.id for cause in found.causes) == sorted(ids),
    "one_of": lambda found, ids: len(found.causes) == 1 and found.causes[0].id in ids,
    "has": lambda found, begins: any(cause.id.startswith(begins) for cause in found.causes),
    "lacks": lambda found, begins: not any(cause.id.startswith(begins) for cause in found.causes),
    "among": lambda found, ids: set(ids) <= members(found),
    "no_other_than": lambda found, ids: members(found) - {UNKNOWN} == set(ids),
    "sizes": of_causes(lambda cause: cause.size.value),
    "covers": lambda found, sizes: (
        {
            cause.id
            for cause in found.causes
            if cause.id in sizes and cause.size.low <= sizes[cause.id] <= cause.size.high
        }
        == set(sizes)
    ),
    "onset_s": of_causes(lambda cause: cause.onset_s),
    "until_s": of_causes(lambda cause: cause.until_s),
    "rivals": of_causes(lambda cause: [rival.id for rival in cause.rivals]),
    "scope": of_causes(lambda cause: cause.scope),
    "member": of_causes(lambda cause: cause.member),
    "probability": of_causes(lambda cause: cause.probability),
    "all_said": lambda found, p: (
        sum(one.probability for cause in found.causes for one in (cause, *cause.rivals)) == p
    ),
    "left": lambda found, some: (
        bool(found.unexplained)
        and all((one.channel, one.variable) in some for one in found.unexplained)
    ),
    "in_interval": lambda found, _: all(
        one.size.low < one.size.value < one.size.high for one in found.causes
    ),
    "gain_in_interval": lambda found, _: all(
        one.low <= one.after <= one.high for one in found.gain
    ),
    "gain": lambda found, share: found.gain[0].after / found.gain[0].before == share,
    "held_out": lambda found, words: words in found.gain[0].held_out,
    "share_left": lambda found, share: (
        [one.explained_share for one in found.unexplained] == [share]
    ),
    "structure_p": lambda found, p: found.channels[0].structure_p == p,
    "unexplained": lambda found, left: (
        [(one.channel, one.variable) for one in found.unexplained] == left
    ),
    "first_left": lambda found, fields: (
        bool(found.unexplained)
        and all(getattr(found.unexplained[0], name) == value for name, value in fields.items())
    ),
    "variables": lambda found, names: {one.variable for one in found.unexplained} == set(names),
    "explained": lambda found, channels: (
        not {one.channel for one in found.unexplained} & set(channels)
    ),
    "terms": lambda found, expected: forms(found) == expected,
    "coefficients": lambda found, sizes: all(
        found.terms[0].term["coefficients"][name] == size for name, size in sizes.items()
    ),
    "over": lambda found, name: any(over == [name] for _, _, over in forms(found)),
    "channels": lambda found, names: {one.channel for one in found.channels} == set(names),
    "says": lambda found, words: all(
        any(word in text for text in found.findings)
        for word in ([words] if isinstance(words, str) else words)
    ),
    "says_one_of": lambda found, words: any(
        word in text for word in words for text in found.findings
    ),
    "says_of": lambda found, words: any(
        all(word in text for word in words) for text in found.findings
    ),
    "not_shown": lambda found, ids: (
        set(ids) <= {one.id for one in found.not_shown if one.smallest_detectable.value is None}
    ),
    "probabilities": lambda found, p: all(one.probability == p for one in found.causes),
    "bias": lambda found, size: found.channels[0].bias == size,
    "members": lambda found, ids: members(found) == set(ids),
    "never_says": lambda found, words: not any(words in text for text in found.findings),
    "rates": lambda found, many: len(found.rates) == many,
    "next_run": lambda found, words: found.next_run is not None and words in found.next_run.plan,
}


def check(found: Diagnosis, **said: Any) -> None:
    """Every question is answered as expected; and whatever is named, something can be done
    about it."""
    wrong = answered_wrongly(found, said)
    assert not wrong and all(cause.advice for cause in found.causes), (wrong, found)


def answered_wrongly(found: Diagnosis, said: Mapping[str, Any]) -> dict[str, Any]:
    """The questions that are not answered as expected, and what was expected."""
    return {
        question: expected
        for question, expected in said.items()
        if not QUESTIONS[question](found, expected)
    }


def shaft_predicted(columns: Columns, machine: Machine) -> tuple[Any, Any]:
    """Shaft speeds as they were read, and as a machine file predicts them (rows,)."""
    clean = clean_run_log(
        {name: np.asarray(values) for name, values in columns.items()}, machine.has_stage
    )
    rows = simulate_drive_rows(read_whole_drives(clean, machine)["shaft"])
    return clean.columns["shaft_rpm"], rows(
        make_schedule(list_stages(machine), ()), MAX_MODEL_STEP_S
    )[:, 1]


def error_on(columns: Columns, machine: Machine) -> float:
    """Root mean square of what a machine file leaves of the shaft's speed, r/min."""
    read, predicted = shaft_predicted(columns, machine)
    return float(np.sqrt(np.nanmean(np.square(read - predicted)[1:])))

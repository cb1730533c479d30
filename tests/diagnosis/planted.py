"""A planted case: a log, the machine file it is held against, and what a diagnosis is to say. One check for all."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from control.diagnosis.result import UNKNOWN, Cause, Diagnosis
from control.diagnosis.runs.channels import drive_rows
from control.diagnosis.runs.diagnose import diagnose_run
from control.diagnosis.runs.drives import whole_drives
from control.diagnosis.runs.hypothesis import schedule, stages_of
from control.diagnosis.runs.log import gate
from control.machine.machine import Machine
from control.machine.over_log import MOST_STEP_S
from tests.diagnosis.logs import Columns

Question = Callable[[Diagnosis, Any], bool]


def planted(name: str, log: Callable[[], Columns], machine: Machine | str | None = None, *, exam: bool = False,
            **said: Any) -> Any:
    """A row of a table of cases: parameters `log`, `machine` (the nominal one) and `said` (QUESTIONS)."""
    return pytest.param(log, machine or Machine(), said, id=name, marks=[pytest.mark.exam] * exam)


def found_as_planted(log: Callable[[], Columns], machine: Machine | str, said: Mapping[str, Any]) -> None:
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
    return {name for cause in found.causes for name in (cause.id, *(rival.id for rival in cause.rivals))}


def forms(found: Diagnosis) -> list[tuple[str, str, list[str]]]:
    """Of each term what it acts on, its form, and over what."""
    return [(term["acts_on"], term["form"], sorted(v["name"] for v in term["over"]))
            for term in (one.term for one in found.terms)]


# What may be asked of a diagnosis: of it and of what is expected.
QUESTIONS: dict[str, Question] = {
    "verdict": lambda found, words: found.verdict in ([words] if isinstance(words, str) else words),
    "names": lambda found, ids: sorted(cause.id for cause in found.causes) == sorted(ids),      # and no others
    "one_of": lambda found, ids: len(found.causes) == 1 and found.causes[0].id in ids,
    "has": lambda found, begins: any(cause.id.startswith(begins) for cause in found.causes),
    "lacks": lambda found, begins: not any(cause.id.startswith(begins) for cause in found.causes),
    "among": lambda found, ids: set(ids) <= members(found),
    "no_other_than": lambda found, ids: members(found) - {UNKNOWN} == set(ids),
    "sizes": of_causes(lambda cause: cause.size.value),
    "covers": lambda found, sizes: {cause.id for cause in found.causes if cause.id in sizes
                                    and cause.size.low <= sizes[cause.id] <= cause.size.high} == set(sizes),
    "onset_s": of_causes(lambda cause: cause.onset_s),
    "until_s": of_causes(lambda cause: cause.until_s),
    "rivals": of_causes(lambda cause: [rival.id for rival in cause.rivals]),
    "scope": of_causes(lambda cause: cause.scope),
    "unexplained": lambda found, left: [(one.channel, one.variable) for one in found.unexplained] == left,
    "first_left": lambda found, name: bool(found.unexplained) and found.unexplained[0].variable == name,
    "explained": lambda found, channels: not {one.channel for one in found.unexplained} & set(channels),
    "terms": lambda found, expected: forms(found) == expected,
    "over": lambda found, name: any(over == [name] for _, _, over in forms(found)),
    "channels": lambda found, names: {one.channel for one in found.channels} == set(names),
    "says": lambda found, words: all(any(word in text for text in found.findings)
                                     for word in ([words] if isinstance(words, str) else words)),
    "never_says": lambda found, words: not any(words in text for text in found.findings),
    "rates": lambda found, many: len(found.rates) == many,
    "next_run": lambda found, words: found.next_run is not None and words in found.next_run.plan,
}


def check(found: Diagnosis, **said: Any) -> None:
    """Every question is answered as expected; and whatever is named, something can be done about it."""
    wrong = {question: expected for question, expected in said.items() if not QUESTIONS[question](found, expected)}
    assert not wrong and all(cause.advice for cause in found.causes), (wrong, found)


def shaft_predicted(columns: Columns, machine: Machine) -> tuple[Any, Any]:
    """Shaft speeds as they were read, and as a machine file predicts them (rows,)."""
    clean = gate({name: np.asarray(values) for name, values in columns.items()}, machine.has)
    rows = drive_rows(whole_drives(clean, machine)["shaft"])
    return clean.columns["shaft_rpm"], rows(schedule(stages_of(machine), ()), MOST_STEP_S)[:, 1]


def error_on(columns: Columns, machine: Machine) -> float:
    """Root mean square of what a machine file leaves of the shaft's speed, r/min."""
    read, predicted = shaft_predicted(columns, machine)
    return float(np.sqrt(np.nanmean(np.square(read - predicted)[1:])))

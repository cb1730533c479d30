"""A planted case: a log, the machine file it is held against, and what a diagnosis is to say. One check for all."""
from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
import pytest

from control.diagnosis.result import Diagnosis
from control.diagnosis.runs.channels import drive_rows
from control.diagnosis.runs.diagnose import diagnose_run
from control.diagnosis.runs.drives import whole_drives
from control.diagnosis.runs.hypothesis import schedule, stages_of
from control.diagnosis.runs.log import gate
from control.machine.machine import Machine
from control.machine.over_log import MOST_STEP_S
from tests.diagnosis.logs import Columns


def planted(name: str, log: Callable[[], Columns], machine: Machine | str | None = None, *, exam: bool = False,
            **said: Any) -> Any:
    """A row of a table of cases: parameters `log`, `machine` (the nominal one) and `said` (of `check`)."""
    return pytest.param(log, machine or Machine(), said, id=name, marks=[pytest.mark.exam] * exam)


def found_as_planted(log: Callable[[], Columns], machine: Machine | str, said: Mapping[str, Any]) -> None:
    check(diagnose_run(log(), machine), **said)


def check(found: Diagnosis, *, verdict: str | Collection[str] = "", names: Collection[str] | None = None,
          one_of: Collection[str] = (), has: str = "", lacks: str | tuple[str, ...] = (),
          sizes: Mapping[str, Any] | None = None, covers: Mapping[str, float] | None = None, onset_s: Any = None,
          until_s: Any = None, rivals: Collection[str] | None = None,
          unexplained: Collection[tuple[str, str]] | None = None, explained: Collection[str] = (),
          terms: Collection[Any] | None = None, over: str = "", channels: Collection[str] | None = None,
          says: str = "", never_says: str = "") -> None:
    """verdict : that, or one of several. names : ids of the causes, and no others. one_of : of the only cause.
    has, lacks : an id, or how ids begin. sizes : of a cause its size, an approx. covers : what lies in its interval.

    onset_s, until_s, rivals : of the cause that is `has`, else of the first. unexplained : channel and variable, all.
    explained : channels of which nothing is unexplained. terms : on what, form, over what. over : a variable over
    which alone there is a term. says, never_says : in one of the findings, in none.
    """
    by_id = {cause.id: cause for cause in found.causes}
    first = by_id.get(has) or next(iter(found.causes), None)
    left = [(one.channel, one.variable) for one in found.unexplained]
    forms = [(term["acts_on"], term["form"], sorted(v["name"] for v in term["over"]))
             for term in (one.term for one in found.terms)]
    held = {
        "advice": all(cause.advice for cause in found.causes),
        "verdict": not verdict or found.verdict in ([verdict] if isinstance(verdict, str) else verdict),
        "names": names is None or sorted(cause.id for cause in found.causes) == sorted(names),
        "one_of": not one_of or (len(found.causes) == 1 and found.causes[0].id in one_of),
        "has": not has or any(name.startswith(has) for name in by_id),
        "lacks": not lacks or not any(name.startswith(lacks) for name in by_id),
        "sizes": all(name in by_id and by_id[name].size.value == size for name, size in (sizes or {}).items()),
        "covers": all(name in by_id and by_id[name].size.low <= value <= by_id[name].size.high
                      for name, value in (covers or {}).items()),
        "onset_s": onset_s is None or (first is not None and first.onset_s == onset_s),
        "until_s": until_s is None or (first is not None and first.until_s == until_s),
        "rivals": rivals is None or (first is not None and {one.id for one in first.rivals} == set(rivals)),
        "unexplained": unexplained is None or left == list(unexplained),
        "explained": not {channel for channel, _ in left} & set(explained),
        "terms": terms is None or forms == list(terms),
        "over": not over or any(variables == [over] for _, _, variables in forms),
        "channels": channels is None or {one.channel for one in found.channels} == set(channels),
        "says": not says or any(says in text for text in found.findings),
        "never_says": not never_says or not any(never_says in text for text in found.findings)}
    assert all(held.values()), ([what for what, well in held.items() if not well], found)


def shaft_predicted(columns: Columns, machine: Machine) -> tuple[Any, Any]:
    """Shaft speeds as they were read, and as a machine file predicts them (rows,)."""
    clean = gate({name: np.asarray(values) for name, values in columns.items()}, machine.has)
    rows = drive_rows(whole_drives(clean, machine)["shaft"])
    return clean.columns["shaft_rpm"], rows(schedule(stages_of(machine), ()), MOST_STEP_S)[:, 1]


def error_on(columns: Columns, machine: Machine) -> float:
    """Root mean square of what a machine file leaves of the shaft's speed, r/min."""
    read, predicted = shaft_predicted(columns, machine)
    return float(np.sqrt(np.nanmean(np.square(read - predicted)[1:])))

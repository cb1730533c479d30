"""What do a machine's terms add up to, quantity by quantity, tick by tick or over a log?

Both use the same evaluator.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .machine import Machine
from .model_elements import Array, DelayLine, average_line, convert_to_lists, make_line, put_in_line
from .shaft import calc_dead_time_s
from .term_form import FORMS, SHAFT_ANGLE, TermParams, TermRun
from .term_step import TermState, step_term
from .terms import (
    COMMANDED_MM,
    COMMANDED_RPM,
    VARIABLES,
    Term,
    TermTarget,
    list_needed_values,
    make_term_params,
)


class TermTotals(NamedTuple):
    """Holds the sum of the terms for each quantity, in its own unit (`terms.TARGET_UNITS`); the
    names are those of `TermTarget`."""

    shaft_percent: float = 0.0
    shaft_rpm: float = 0.0
    gate_mm: float = 0.0
    flow_percent: float = 0.0
    flow_kg_min: float = 0.0
    scale_kg: float = 0.0
    scale_kg_min: float = 0.0
    wheel_percent: float = 0.0


NO_TERMS = TermTotals()


class TermSums:
    """Advances the terms of a machine with their memories. A term without its values is left
    out."""

    def __init__(self, terms: Iterable[Term]) -> None:
        self._terms = [
            (term.acts_on.value, make_term_params(term), list_needed_values(term)) for term in terms
        ]
        self._states = [TermState()] * len(self._terms)
        self._dt_s = 0.0

    def __bool__(self) -> bool:
        return bool(self._terms)

    def advance_terms(self, values: Mapping[str, float], dt_s: float) -> TermTotals:
        """Returns the sums for the variables `values`, `dt_s` after the step before."""
        more = dict.fromkeys(TermTotals._fields, 0.0)
        for k, (acts_on, params, names) in enumerate(self._terms):
            if all(name in values for name in names):
                x, y = values[names[0]], values[names[-1]]
                self._states[k], value = step_term(params, self._states[k], x, y, dt_s)
                more[acts_on] += value
        return TermTotals(**more)

    def freeze_terms(self, values: Mapping[str, float]) -> FrozenTerms:
        """Returns the terms in their present state, for evaluation at other set-points."""
        return FrozenTerms(tuple(self._terms), tuple(self._states), dict(values))


class FrozenTerms(NamedTuple):
    """Holds terms under constant conditions, with their sums at given set-points, for the
    inverse of the model."""

    terms: tuple[tuple[str, TermParams, tuple[str, ...]], ...]
    states: tuple[TermState, ...]
    values: dict[str, float]

    def find_totals(self, only: Sequence[TermTarget], **set_points: float) -> TermTotals:
        """Returns the sums of some quantities with some of the values replaced."""
        values = {**self.values, **set_points}
        more: dict[str, float] = {}
        for (acts_on, params, names), state in zip(self.terms, self.states, strict=True):
            if acts_on in only and all(name in values for name in names):
                _, value = step_term(params, state, values[names[0]], values[names[-1]], 0.0)
                more[acts_on] = more.get(acts_on, 0.0) + value
        return TermTotals(**more)


class HeldCommands:
    """Averages over each step the commands that the drives follow at that time, after their dead
    times."""

    def __init__(self, machine: Machine, shaft_rpm: float, opening_mm: float) -> None:
        self._dead_s = calc_dead_times_s(machine)
        self._lines: list[DelayLine] = [
            convert_to_lists(make_line(shaft_rpm)),
            convert_to_lists(make_line(opening_mm)),
        ]

    def average_commands(
        self, now_s: float, shaft_rpm: float, opening_mm: float, dt_s: float
    ) -> dict[str, float]:
        """Stores the commands given at `now_s` and held for `dt_s`, and returns the averages."""
        found = {}
        for k, (name, value) in enumerate(((COMMANDED_RPM, shaft_rpm), (COMMANDED_MM, opening_mm))):
            begin_s = now_s - self._dead_s[k]
            self._lines[k], found[name] = average_line(
                put_in_line(self._lines[k], now_s, value), begin_s, begin_s + dt_s
            )
        return found


def calc_dead_times_s(machine: Machine) -> tuple[float, float]:
    """Returns the dead times of shaft and gate, s."""
    return calc_dead_time_s(machine.shaft), machine.gate.dead_time_s


def sum_over_log(
    terms: Iterable[Term], values: Mapping[str, Array], time_s: Array, run: TermRun
) -> dict[str, Array]:
    """Returns the sums over a log, (rows,) by quantity; quantities without a term are left out.

    values: by the names of the variables, (rows,) each. Terms without their values add nothing.
    """
    found: dict[str, Array] = {}
    for term in terms:
        names = list_needed_values(term)
        if all(name in values for name in names):
            series = run(
                make_term_params(term),
                np.ascontiguousarray(values[names[0]], dtype=np.float64),
                np.ascontiguousarray(values[names[-1]], dtype=np.float64),
                time_s,
            )
            found[term.acts_on.value] = found.get(term.acts_on.value, 0.0) + series
    return found


def average_commands_over_log(command: Array, time_s: Array, dead_s: float) -> Array:
    """Returns the values of `HeldCommands` over a log: mean of the held command over each row,
    delayed by `dead_s` (rows,)."""
    if len(time_s) < 2:
        return command
    spans = np.diff(time_s)
    summed = np.concatenate(([0.0], np.cumsum(command[:-1] * spans)))
    width = np.append(spans, spans[-1])
    begin = time_s - dead_s

    def until(at: Array) -> Array:
        inside = np.interp(at, time_s, summed)
        return (
            inside
            + np.where(at < time_s[0], (at - time_s[0]) * command[0], 0.0)
            + np.where(at > time_s[-1], (at - time_s[-1]) * command[-1], 0.0)
        )

    return np.asarray((until(begin + width) - until(begin)) / width)


def calc_angle_over_log(shaft_rpm: Array, time_s: Array) -> Array:
    """Returns the shaft's angle in the middle of each row, degrees since the log began (rows,)."""
    spans = np.diff(time_s, append=time_s[-1])
    turned = 6.0 * shaft_rpm * spans
    return np.asarray(np.concatenate(([0.0], np.cumsum(turned)[:-1])) + 0.5 * turned)


def explain_not_compensated(term: Term, known: Iterable[str] = ()) -> str:
    """Returns the reason why control cannot compensate a term; "" where it does. known: further
    columns of a device."""
    if FORMS[term.form].one_run:
        return "it holds for a span of one run"
    if SHAFT_ANGLE in term.variable_names:
        return "control does not know the shaft's angle when what it commands comes to pass"
    if term.stage == "speed":
        return "control does not read the wheel through it"
    extra = [name for name in term.variable_names if name not in VARIABLES and name not in known]
    if extra:
        return f"no device tells control {extra[0]}"
    return ""


def explain_partly_compensated(term: Term) -> str:
    """Returns the part of a compensated term that control cannot predict; "" where it predicts
    everything."""
    if "speed_mps" in term.variable_names:
        return "with the speed of now, not with that at landing"
    if "time_s" in term.variable_names:
        return "with the time since this run began"
    return ""

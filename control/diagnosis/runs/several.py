"""Diagnoses several logs of one machine: common errors are found once on all logs, differences are
reported by log.

Logs of machines of a kind (two robots with the same motors) have the same faults in different
sizes. Cochran's test (Biometrics 10, 1954, 101), at the significance level of the checks, decides
whether the sizes are equal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc
from topdress.control.diagnosis.dataframe_input import load_machine, read_columns
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.judgement.checks import FALSE_ALARM_PROB
from topdress.control.diagnosis.judgement.evidence import TWO_SIDED_90_QUANTILE
from topdress.control.diagnosis.result import Diagnosis, Size
from topdress.control.log_row import COMMANDS_HELD_EVENT, FILE_BEGINS
from topdress.control.machine.machine import Machine

from .adoption import select_adoptable
from .diagnose import Each, diagnose_run
from .drives import SETTLE_S, START_SETTLE_TAUS

Columns = dict[str, npt.NDArray[Any]]

# Gap between consecutive logs, s, as `import` joins runs.
LOG_GAP_S = 60.0
# Readings that are not judged while a drive settles to the first command of a log.
SETTLING_COLUMNS = ("shaft_rpm", "opening_mm", "hopper_kg")


class SharedEffect(NamedTuple):
    """An effect of every log. sizes : size in each log, in order. p : p value of equal sizes."""

    id: str
    member: int | None
    sizes: tuple[Size, ...]
    p: float


class JointDiagnosis(NamedTuple):
    """Result of several logs. together : diagnosis of all logs as one, against the given machine
    file. machine : that file with the common effects that predict better (`adoption`). each :
    diagnosis of every log against `machine`, so only its own errors remain.

    of_a_kind : for logs of machines of a kind, the effects of every log with their own sizes.
    `machine` is then the given file, and `each` contains all errors of a log.
    """

    together: Diagnosis
    machine: Machine
    each: tuple[Diagnosis, ...]
    of_a_kind: tuple[SharedEffect, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the joint diagnosis for JSON; `logs` holds the additional errors of each log,
        `of_a_kind` the sizes by log."""
        return {
            **self.together.to_json(),
            "logs": [one.to_json() for one in self.each],
            "of_a_kind": [
                {**one._asdict(), "sizes": [asdict(size) for size in one.sizes]}
                for one in self.of_a_kind
            ],
        }


def diagnose_runs(
    logs: Sequence[Any],
    machine: Machine | str,
    *,
    paths: Sequence[str] = (),
    progress: Callable[[float, str], None] | None = None,
    each: Each = map,
) -> JointDiagnosis:
    """Diagnose several logs of one machine: name common errors once, and report the own errors of
    each log.

    The logs are concatenated and judged as one, so a size is common to all of them. Then each log
    is compared with the machine that includes the common errors.

    Parameters
    ----------
    logs
        Tables of columns (n,), in any form that `diagnose_run` takes, two or more.
    machine
        As for `diagnose_run`.
    paths
        Paths of the logs, for the result.
    progress
        `progress(share, word)` is called between steps.
    each
        `map`, or the `map` of a pool.

    Returns
    -------
    Several
        The joint diagnosis, the adopted machine file, and the diagnosis of each log.

    Raises
    ------
    ValueError
        One line, for fewer than two logs, a log without times, or where some logs hold settled
        answers and others do not.

    Examples
    --------
    >>> import numpy as np
    >>> from topdress.control.machine.machine import Machine
    >>> def log(seed):
    ...     rng, time_s = np.random.default_rng(seed), np.arange(0.0, 120.0, 0.1) ...     speed_mps
    = 1.3 + 0.2 * np.sin(time_s / (5.0 + seed)) ...     return {"time_s": time_s, "speed_mps":
    speed_mps + 0.03 * rng.standard_normal(1200), ...             "wheel_speed_mps": 1.02 *
    speed_mps + 0.02 * rng.standard_normal(1200)}
    >>> found = diagnose_runs([log(1), log(2)], Machine())
    >>> [cause.id for cause in found.together.causes], [one.verdict for one in found.each]
    (['speed.wheel_radius'], ['none', 'none'])
    """
    of = load_machine(machine)
    given = [read_columns(log) for log in logs]
    names = [*paths, *(f"log {k + 1}" for k in range(len(paths), len(given)))]

    def part(number: int) -> Callable[[float, str], None] | None:
        if progress is None:
            return None
        return lambda share, word: progress((number + share) / (1 + 2 * len(given)), word)

    together = diagnose_run(
        join_logs(given, names, of), of, path=" + ".join(names), progress=part(0), each=each
    )
    taken = select_adoptable(together, [cause.id for cause in together.causes])
    known = extend(of, taken.found)
    together = replace(
        together,
        findings=(
            *together.findings,
            *(
                f"{name}: not in the machine that each log is held against: {why}"
                for name, why in taken.refused
            ),
        ),
    )

    def against(file: Machine, first: int) -> tuple[Diagnosis, ...]:
        return tuple(
            diagnose_run(log, file, path=name, progress=part(first + k), each=each)
            for k, (log, name) in enumerate(zip(given, names, strict=True))
        )

    alone = against(known, 1)
    if any(one.causes for one in alone):
        whole = against(of, 1 + len(given))
        if kinds := find_shared_effects(whole, alone):
            asked = note_differing_columns(whole, kinds)
            together = replace(together, findings=(*together.findings, *asked))
            return JointDiagnosis(together, of, whole, kinds)
    return JointDiagnosis(together, known, alone)


def find_shared_effects(
    each: Sequence[Diagnosis], beyond: Sequence[Diagnosis]
) -> tuple[SharedEffect, ...]:
    """Return the permanent effects of every log, where the size of at least one differs between
    logs so that a log shows it beyond the common size; else none."""
    left = {(cause.id, cause.member) for one in beyond for cause in one.causes}
    steady = [
        {
            (cause.id, cause.member): cause
            for cause in one.causes
            if cause.onset_s is None
            and not cause.rivals
            and None not in (cause.size.value, cause.size.low, cause.size.high)
        }
        for one in each
    ]
    found = []
    for key in steady[0]:
        if all(key in one for one in steady):
            sizes = tuple(one[key].size for one in steady)
            found.append(SharedEffect(*key, sizes, _calc_cochran_p(sizes)))
    return (
        tuple(found)
        if any(one.p < FALSE_ALARM_PROB and (one.id, one.member) in left for one in found)
        else ()
    )


def note_differing_columns(
    each: Sequence[Diagnosis], kinds: Sequence[SharedEffect]
) -> tuple[str, ...]:
    """Return findings about recorded columns whose ranges in two logs have nothing in common: one
    machine whose effect depends on such a column is no pair of machines of a kind."""
    unequal = ", ".join(one.id for one in kinds if one.p < FALSE_ALARM_PROB)
    found = []
    for name in sorted(set.intersection(*({*one.excited} for one in each)) - {"time_s"}):
        ranges = [one.excited[name] for one in each]
        if max(low for low, _ in ranges) <= min(high for _, high in ranges):
            continue
        middles = np.array([0.5 * (low + high) for low, high in ranges])
        follows = len(each) > 2 and all(
            _calc_cochran_p(one.sizes, middles) >= FALSE_ALARM_PROB for one in kinds
        )
        values = ", ".join(f"{middle:.4g}" for middle in middles)
        found.append(
            f"{name} differs between the logs as well ({values})"
            + (f", and a straight line over it gives the sizes of {unequal}" if follows else "")
            + f": is it one machine whose {unequal} depends on {name}? One machine recorded at "
            "both values would tell it from machines of a kind"
        )
    return tuple(found)


def _calc_cochran_p(sizes: Sequence[Size], along: npt.NDArray[np.float64] | None = None) -> float:
    """Return the p value of Cochran's Q: the probability of such different sizes if the true size
    is equal, or a straight line over the values `along` (n,) of a column."""
    values = np.array([size.value for size in sizes], np.float64)
    half = 0.5 * (
        np.array([size.high for size in sizes], np.float64) - np.array([size.low for size in sizes])
    )
    weights = TWO_SIDED_90_QUANTILE / np.maximum(half, 1e-12)
    basis = np.ones((len(values), 1))
    if along is not None:
        basis = np.column_stack((basis, along - along.mean()))
    line = np.linalg.lstsq(basis * weights[:, None], values * weights, rcond=None)[0]
    left = weights * (values - basis @ line)
    return float(chdtrc(len(values) - basis.shape[1], float(left @ left)))


def join_logs(
    logs: Sequence[Mapping[str, npt.NDArray[Any]]], names: Sequence[str], machine: Machine
) -> Columns:
    """Concatenate several logs with LOG_GAP_S between them; a column that a log lacks is empty in
    its rows. An event marks the start of each log.

    Raises ValueError where the logs cannot be judged as one.
    """
    if len(logs) < 2:
        raise ValueError(f"{len(logs)} log: allowed two or more")
    held = [
        any(COMMANDS_HELD_EVENT in str(text).split(";") for text in log.get("events", ()))
        for log in logs
    ]
    if len(set(held)) > 1:
        raise ValueError(
            f"{names[held.index(True)]} holds settled answers, {names[held.index(False)]} "
            "does not: "
            "allowed logs of one kind together"
        )
    settle_s = min(
        SETTLE_S, START_SETTLE_TAUS * (machine.shaft.dead_time_s + machine.shaft.time_constant_s)
    )
    kinds = {
        name: np.asarray(values).dtype.kind
        for log in reversed(logs)
        for name, values in log.items()
    }
    kinds["events"] = "O"
    parts: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in kinds}
    begin_s = 0.0
    for number, log in enumerate(logs):
        time_s = np.asarray(log["time_s"], np.float64)
        since = time_s - np.nanmin(time_s)
        for name, kind in kinds.items():
            parts[name].append(_join_column(log, name, kind, since, settle_s if number else 0.0))
        parts["time_s"][-1] = begin_s + since
        parts["events"][-1] = _mark_start_event(parts["events"][-1], since, names[number])
        begin_s += float(np.nanmax(since)) + LOG_GAP_S
    return {name: np.concatenate(pieces) for name, pieces in parts.items()}


def _join_column(
    log: Mapping[str, npt.NDArray[Any]],
    name: str,
    kind: str,
    since: npt.NDArray[np.float64],
    settle_s: float,
) -> npt.NDArray[Any]:
    if name not in log:
        return np.full(len(since), "", object) if kind == "O" else np.full(len(since), np.nan)
    values = np.asarray(log[name])
    return (
        np.where(since < settle_s, np.nan, values)
        if name in SETTLING_COLUMNS and settle_s > 0.0
        else values
    )


def _mark_start_event(
    events: npt.NDArray[Any], since: npt.NDArray[np.float64], name: str
) -> npt.NDArray[Any]:
    """Return the events with a mark in the first row that has a time, as `import` writes it."""
    found, first = events.astype(object), int(np.nanargmin(since))
    was = found[first]
    mark = f"{FILE_BEGINS}{name.replace(';', ' ')}"
    found[first] = f"{was};{mark}" if isinstance(was, str) and was else mark
    return found

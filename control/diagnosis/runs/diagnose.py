"""Diagnoses a run log, from columns to verdict.

An unusual log may lead to a singular matrix or a sum without a finite value. Such a failure is the
program's own, is never reported as a mistake of the user, and must not stop the other channels
(`attempt_step`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache, partial
from pathlib import PurePath
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.dataframe_input import (
    LogTable,
    find_misspelt_columns,
    load_machine,
    name_frame_library,
    read_columns,
)
from topdress.control.diagnosis.prediction.log_prediction import LogPredictor
from topdress.control.diagnosis.prediction.plain_rival import find_curves
from topdress.control.diagnosis.prediction.predictive_validation import validate_prediction
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.machine.machine import Machine
from topdress.control.recordings.valid_values import blank_unreadable

from .channels import ChannelSeries, make_channels, remove_narrowband
from .findings import (
    note_doubted_units,
    note_effort_inputs,
    note_faults_between_rows,
    note_hardly_read,
    note_left_ranges,
    note_reverse_turning,
    note_unloaded_flanks,
    note_unread_efforts,
    note_unsure_drives,
    note_whole_log,
)
from .hypothesis import Hypothesis
from .intermittent import DirectDetection, remove_spells
from .log import CleanLog, clean_run_log, fit_answers_to_log
from .model import CHANNEL_GROUPS
from .quantised import correct_steps
from .rates import describe_rate_fit, fit_rate_passes
from .report import make_report
from .row_order import order_log_rows
from .search import Search
from .selection import GroupResult, judge_group
from .stages import RunData, make_run_data

T = TypeVar("T")
# Number of model runs after which the progress bar shows half: the total number is unknown in
# advance.
HALF_PROGRESS_RUNS = 200
Progress = Callable[[float, str], None]
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


class Cancelled(Exception):
    """Raised when the user has cancelled the diagnosis."""


def attempt_step(what: str, work: Callable[[], T], findings: list[str]) -> T | None:
    """Return the result of `work`, or None with a finding about `what` where it fails.

    Overflow and underflow raise no warning, because `has_finite_numbers` examines the results.
    Every exception is caught, because the effect of an unknown log on a formula cannot be foreseen.
    The finding contains file and line, so that the user can report the failure.
    """
    try:
        with np.errstate(all="ignore"):
            return work()
    except Cancelled:
        raise
    except Exception as error:
        findings.append(
            f"{what}: left out: the program's own arithmetic fails on this log "
            f"({type(error).__name__} at {_locate_error(error)}; please report it)"
        )
        return None


def _locate_error(error: Exception) -> str:
    """Return the file and line of this program that raised the error."""
    trace, found = error.__traceback__, "?"
    while trace is not None:
        path = PurePath(trace.tb_frame.f_code.co_filename)
        if "control" in path.parts:
            found = f"{path.name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return found


def has_finite_numbers(value: Any) -> bool:
    """Tell whether all numbers in a result are finite."""
    if isinstance(value, float):
        return math.isfinite(value)
    if is_dataclass(value):
        return all(has_finite_numbers(getattr(value, one.name)) for one in fields(value))
    if isinstance(value, dict):
        return all(map(has_finite_numbers, value.values()))
    return all(map(has_finite_numbers, value)) if isinstance(value, list | tuple) else True


def join_channel_names(channels: Iterable[str]) -> str:
    """Return a list of channels as text for a sentence."""
    found = list(channels)
    return found[0] if len(found) == 1 else f"{', '.join(found[:-1])} and {found[-1]}"


class JudgedRun(NamedTuple):
    """A diagnosis, the log as its stages see it, and its groups of channels with their searches."""

    found: Diagnosis
    data: RunData
    groups: tuple[GroupResult, ...]


def diagnose_run(
    columns: LogTable,
    machine: Machine | str,
    *,
    path: str = "",
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    seed: int = 0,
    each: Each = map,
) -> Diagnosis:
    """Diagnose a run log: find the errors of the machine model, their causes, and the gain of
    correcting them.

    Parameters
    ----------
    columns
        Columns of shape (n,), with a row for each control tick or any other step, by the run log's
        column names and units (contract of the run log): a dict of arrays or lists, a pandas or
        polars DataFrame, a list of dicts, an array with named fields. Only `time_s` is required (or
        `time_ms`, or dates: `control.diagnosis.dataframe_input`). A stage without its columns is
        left out, and the findings say so.
    machine
        The machine of the machine file, or that file's path, or the name of a shipped file
        ("drive_alone"). Its tolerances are priors; found sizes are added to its own effects.
    path
        Path of the data, for the result.
    progress
        `progress(share, word)` is called repeatedly, share from 0 to 1; an exception from it ends
        the diagnosis as well.
    cancelled
        Called at every run of the model, many times a second; True ends the diagnosis with
        `Cancelled`.
    seed
        Unused for a run; `diagnose_tables` draws its probabilities with it.
    each
        `map`, or the `map` of a pool: the groups of channels may be judged in parallel.

    Returns
    -------
    Diagnosis
        A notebook shows the result; `found.plot()` shows its pictures. By the contract
        "topdress-diagnosis/1", sizes and their 90 % intervals are in the catalogue's units
        (`topdress effects`), residuals in r/min, mm, kg, kg/s, m/s and NDVI. Field costs are in %
        and m.

    Raises
    ------
    ValueError
        One line, where there is no time column or fewer rows than a diagnosis needs, where
        columns differ in length or contain anything but numbers, and for a machine that no file
        describes.
    Cancelled
        Where `cancelled` returned True.

    Notes
    -----
    Each channel is predicted through the machine model from the measured output of the stage
    before. The likelihood is Whittle's, in the cosine domain, with a fast and a slow noise refitted
    under every hypothesis [1]_; pseudo-values reduce heavy tails [2]_. A score test of the
    simulated column proposes effects; log evidence and prior odds, refitted through the model,
    weigh them [3]_ (control/diagnosis/judgement). The gain is measured on blocks to which no size
    was fitted.

    References
    ----------
    .. [1] Whittle, Estimation and information in stationary time series, Arkiv for Matematik 2,
        1953.
    .. [2] Huber and Ronchetti, Robust Statistics, 2nd ed., 2009, 7.8. .. [3] Kass and Raftery,
    Bayes factors, J. Am. Stat. Assoc. 90, 1995.

    Examples
    --------
    Four minutes in which the wheel reads 2 % more than the ground speed, ten rows a second:

    >>> import numpy as np
    >>> from topdress.control.machine.machine import Machine
    >>> rng, time_s = np.random.default_rng(1), np.arange(0.0, 240.0, 0.1)
    >>> speed_mps = 1.3 + 0.2 * np.sin(time_s / 7.0)
    >>> columns = {"time_s": time_s, "speed_mps": speed_mps + 0.03 * rng.standard_normal(2400),
    ...            "wheel_speed_mps": 1.02 * speed_mps + 0.02 * rng.standard_normal(2400)}
    >>> found = diagnose_run(columns, Machine())
    >>> found.verdict, [(one.id, round(one.size.value, 1), one.size.unit) for one in found.causes]
    ('named', [('speed.wheel_radius', 2.0, '%')])
    >>> found.gain[0].after < 0.9 * found.gain[0].before
    True
    """
    given = read_columns(columns)
    of = fit_answers_to_log(load_machine(machine), given)
    found = judge_run(given, of, path=path, progress=progress, cancelled=cancelled, each=each).found
    misspelt = find_misspelt_columns(given)
    return replace(
        found,
        findings=(*misspelt, *found.findings),
        seen_with=(given, of),
        frame_library=name_frame_library(columns),
    )


def judge_run(
    columns: Mapping[str, npt.NDArray[Any]],
    machine: Machine,
    *,
    path: str = "",
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    each: Each = map,
) -> JudgedRun:
    """Diagnose a run log as `diagnose_run` does, and return the diagnosis with the intermediate
    results."""
    furthest = 0.0

    def step(share: float, word: str) -> None:
        nonlocal furthest
        # The answer runs the models as well, so the share must not fall back.
        furthest = max(furthest, share)
        if cancelled is not None and cancelled():
            raise Cancelled
        try:
            if progress is not None:
                progress(furthest, word)
        except Exception as error:
            raise Cancelled from error

    step(0.0, "data")
    machine = fit_answers_to_log(machine, columns)
    log, data, read_off = prepare_log(columns, machine)
    findings = [
        *log.findings,
        *note_reverse_turning(log, machine),
        *note_unsure_drives(log, data, machine),
        *note_hardly_read(log, data),
        *note_effort_inputs(log, machine),
        *note_unread_efforts(columns, data),
        *note_doubted_units(data, machine),
        *note_unloaded_flanks(data, machine),
        *note_left_ranges(data, machine),
    ]
    # Numerical warnings are silenced, because `has_finite_numbers` examines the results.
    with np.errstate(all="ignore"):
        seen = make_channels(data, machine)
    step(0.05, "channels")
    without = attempt_step(
        "a speed sensor's narrowband noise", lambda: remove_narrowband(seen, machine), findings
    )
    if without is not None:
        seen = without[0]
        findings += without[1]
    step(0.1, "model")
    on_log = cache(lambda: LogPredictor(log, data, machine))
    groups = _judge_all_groups(
        seen, machine, data, cache(lambda: find_curves(on_log())), step, each, findings
    )
    findings += (
        attempt_step(
            "the drives over every row", lambda: note_whole_log(log, groups, machine), findings
        )
        or []
    )
    findings += note_faults_between_rows(
        log, {part.id for one in groups for part in one.found.parts}
    )
    step(0.9, "result")
    found = attempt_step(
        "", lambda: make_report(data, machine, groups, read_off, path, tuple(findings)), []
    )
    if found is None or not has_finite_numbers(found):
        groups, read_off = _keep_sound_results(groups, read_off, data, machine, findings)
        with np.errstate(all="ignore"):
            found = make_report(data, machine, groups, read_off, path, tuple(findings))
    said, ids = found, {one.part.id for one in read_off}
    held = attempt_step(
        "what its file predicts", lambda: validate_prediction(on_log(), said, ids), findings
    )
    found = (
        held
        if held is not None and has_finite_numbers(held)
        else replace(said, findings=tuple(findings))
    )
    return JudgedRun(
        _add_rate_findings(found, columns) if not found.channels else found, data, tuple(groups)
    )


def _keep_sound_results(
    groups: list[GroupResult],
    read_off: tuple[DirectDetection, ...],
    data: RunData,
    machine: Machine,
    findings: list[str],
) -> tuple[list[GroupResult], tuple[DirectDetection, ...]]:
    """Return the groups and the directly detected effects whose results are finite; a finding
    reports each that is left out."""

    def is_reportable(
        what: str, some: list[GroupResult], seen: tuple[DirectDetection, ...]
    ) -> bool:
        reported = attempt_step(
            what, lambda: make_report(data, machine, some, seen, "", ()), findings
        )
        if reported is not None and not has_finite_numbers(reported):
            findings.append(
                f"{what}: left out: the numbers of this log lead beyond what a computer can hold"
            )
        return reported is not None and has_finite_numbers(reported)

    return (
        [
            one
            for one in groups
            if is_reportable(join_channel_names(one.search.model.names), [one], ())
        ],
        tuple(one for one in read_off if is_reportable(one.part.id, [], (one,))),
    )


def _add_rate_findings(found: Diagnosis, columns: Mapping[str, npt.NDArray[Any]]) -> Diagnosis:
    """Add the applied rate against the target rate to a diagnosis that has no channel."""
    failed: list[str] = []
    sane = {
        name: blank_unreadable(values)
        if np.issubdtype(np.asarray(values).dtype, np.floating)
        else values
        for name, values in columns.items()
    }
    fits, why = attempt_step("applied against target", lambda: fit_rate_passes(sane), failed) or (
        (),
        "",
    )
    if not has_finite_numbers(fits):
        fits, why = (), "its numbers lead beyond what a computer can hold"
    said = failed or [
        describe_rate_fit(fits[0]) if fits else f"applied against target is not judged: {why}"
    ]
    return replace(found, rates=fits, findings=(*found.findings, *said))


def prepare_log(
    columns: Mapping[str, npt.NDArray[Any]],
    machine: Machine,
    ordered: Callable[[CleanLog, Machine], CleanLog] = order_log_rows,
) -> tuple[CleanLog, RunData, tuple[DirectDetection, ...]]:
    """Return the cleaned log, its channels with encoder steps and intermittent effects removed, and
    the removed effects."""
    failed: list[str] = []
    log = clean_run_log(columns, machine.has_stage)
    log = attempt_step("the order of rows", lambda: ordered(log, machine), failed) or log
    in_steps = attempt_step(
        "steps of the shaft's readings", lambda: correct_steps(log, machine), failed
    )
    if in_steps is None:
        data, in_spells = _without_spells(_make_run_data(log, machine, failed), machine, failed)
        return log._replace(findings=(*log.findings, *failed)), data, in_spells
    log, part = in_steps.taken_back, in_steps.seen.part
    data = _make_run_data(log, machine, failed)
    if data.shaft is not None:
        turned = _make_run_data(in_steps.turned, machine, failed)
        data = data._replace(
            shaft=data.shaft._replace(step=part.size, steps_from_s=part.onset_s),
            hopper=turned.hopper,
            efforts=turned.efforts,
        )
    data, in_spells = _without_spells(data, machine, failed)
    return log._replace(findings=(*log.findings, *failed)), data, (in_steps.seen, *in_spells)


def _make_run_data(log: CleanLog, machine: Machine, failed: list[str]) -> RunData:
    """Build the channels of a log. Raises ValueError where no channel can be built."""
    with np.errstate(all="ignore"):
        if (
            data := attempt_step("all channels together", lambda: make_run_data(log, machine), [])
        ) is not None:
            return data
        stages = [
            one
            for one in log.stages
            if attempt_step(
                one, partial(make_run_data, log._replace(stages=(one,)), machine), failed
            )
        ]
        return make_run_data(log._replace(stages=tuple(stages)), machine)


def _without_spells(
    data: RunData, machine: Machine, failed: list[str]
) -> tuple[RunData, tuple[DirectDetection, ...]]:
    return attempt_step(
        "missing pulses and bridges", lambda: remove_spells(data, machine), failed
    ) or (
        data,
        (),
    )


def _judge_all_groups(
    seen: Mapping[str, ChannelSeries],
    machine: Machine,
    data: RunData,
    curves: Callable[[], Sequence[Hypothesis]],
    step: Callable[[float, str], None],
    each: Each,
    findings: list[str],
) -> list[GroupResult]:
    """Judge each group of channels; the groups share only the log."""
    groups = {word: [seen[c] for c in names if c in seen] for word, names in CHANNEL_GROUPS.items()}
    words = [word for word, members in groups.items() if members]
    # Counts model runs by group, to estimate the progress.
    runs = dict.fromkeys(words, 0)

    def judge(word: str) -> GroupResult | None:
        def ask() -> None:
            runs[word] += 1
            step(
                0.1 + 0.8 * sum(k / (k + HALF_PROGRESS_RUNS) for k in runs.values()) / len(words),
                word,
            )

        what = join_channel_names(one.name for one in groups[word])
        return attempt_step(
            what, lambda: judge_group(Search(groups[word], machine, data, ask, curves)), findings
        )

    longest = sorted(words, key=lambda word: -sum(len(one.measured) for one in groups[word]))
    # The longest groups start first and run in parallel, so that none is waited for alone.
    judged = dict(zip(longest, each(judge, longest), strict=True))
    return [one for word in words if (one := judged[word]) is not None]

"""Writes the result of a diagnosis of bench tables: causes, channels, next run, and findings in
words.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.calibration.bench_table import LAG_COLUMNS, BenchTable
from topdress.control.diagnosis.effect_cost import (
    COSTS_OUTSIDE_MODEL,
    OperatingPoint,
    calc_consequence,
    calc_rate_error,
)
from topdress.control.diagnosis.effects import (
    EFFECT_ROWS,
    LAG_COARSE_CLOCK,
    LAG_OFFSET,
    PLACE_LATENCY,
    PLACE_LEVER_ARM,
    SHAFT_DEAD_TIME,
)
from topdress.control.diagnosis.judgement.evidence import TWO_SIDED_90_QUANTILE
from topdress.control.diagnosis.judgement.prior import (
    MIN_LISTED_PROB,
    MIN_NAMED_PROB,
    SEPARATION_SD,
)
from topdress.control.diagnosis.result import (
    Cause,
    Channel,
    FieldCost,
    NextRun,
    Rival,
    Size,
    Verdict,
)
from topdress.control.experiments.bench_tests import list_bench_tests, make_two_rates_test
from topdress.control.experiments.experiment import Experiment, choose_experiments
from topdress.control.experiments.setting_levels import USUAL_SPEED_MPS
from topdress.control.machine.fall import find_start_drop_s
from topdress.control.machine.machine import CATALOGUE, Machine, describe_unit, find_size_bounds
from topdress.control.machine.start_lag import calc_response_s

from .coarse_clock import CoarseClock
from .cross_calibration import compare_lag_series
from .duplicate_rows import DuplicateRows, describe_duplicates
from .held_out_gain import list_label_contrasts
from .problem import TableProblem
from .table_noise import MAX_ROBUST_SD, MAX_UNEQUAL_VARIANCE_P_VALUE
from .table_series import Array, BoolArray, MeasuredSeries, SizedEffect, TableCandidate, add_effects
from .verdict import NamedEffect, TableVerdict

# Effects that add the same time to every row, as the steps of a coarse clock may do.
CONSTANT_TIME_IDS = (SHAFT_DEAD_TIME.id, LAG_OFFSET.id)
# P value below which labels are reported to differ.
MAX_LABEL_CONTRAST_P_VALUE = 0.01
# Ratio of a setting's scatter to the usual scatter from which the setting is reported.
MIN_SETTING_SCATTER_RATIO = 2.0
# Maximum number of rows and of settings that a finding lists.
MAX_SHOWN_ROWS, MAX_SHOWN_SETTINGS = 5, 3
# Minimum number of rows for a setting's scatter to be reported.
MIN_REPORTED_ROWS = 4
# Maximum number of tests of a plan: an afternoon's work.
MAX_PLANNED_TESTS = 3
RivalPair = tuple[SizedEffect, SizedEffect]


def list_causes(
    problem: TableProblem, tables: Sequence[BenchTable], judgement: TableVerdict
) -> tuple[Cause, ...]:
    """Return the named effects and the clearest coarse clock, largest consequence in the field
    first."""
    speed = _find_ground_speed(tables)
    causes = [_make_table_cause(problem, one, speed) for one in judgement.named]
    clocks = [clock for clock in problem.clocks if clock is not None and clock.shown]
    if clocks:
        causes.append(_make_clock_cause(problem, min(clocks, key=lambda clock: clock.p), speed))

    return tuple(sorted(causes, key=lambda cause: calc_consequence(cause.field_cost), reverse=True))


def find_verdict(judgement: TableVerdict, causes: Sequence[Cause]) -> Verdict:
    """Return the verdict of the models together with the clocks."""
    if judgement.verdict not in ("unexplained", "not_judged") or (
        causes and not judgement.unexplained
    ):
        return "ambiguous" if any(one.rivals for one in causes) else "named" if causes else "none"
    return judgement.verdict


def _make_table_cause(problem: TableProblem, one: NamedEffect, speed: float | None) -> Cause:
    candidate, size = one.effect
    rivals = tuple(Rival(r.id, r.probability) for r in one.rivals)
    probability = one.probability
    if candidate.id in CONSTANT_TIME_IDS and any(
        clock is not None and clock.undecided for clock in problem.clocks
    ):
        # No information separates a clock from all other causes, so the clock gets half of the
        # probability.
        probability *= 0.5
        rivals = (
            Rival(LAG_COARSE_CLOCK.id, 0.5),
            *(Rival(r.id, 0.5 * r.probability) for r in rivals),
        )
    interval = Size(
        size,
        size - TWO_SIDED_90_QUANTILE * one.se,
        size + TWO_SIDED_90_QUANTILE * one.se,
        describe_unit(candidate.id, problem.machine),
    )
    return Cause(
        candidate.id,
        interval,
        None,
        probability,
        rivals,
        candidate.member,
        CATALOGUE[candidate.id].effect.advice,
        calc_table_field_cost(problem.machine, one.effect, speed),
        scope=None if candidate.scope is None else problem.scope_name(candidate.scope),
    )


def _make_clock_cause(problem: TableProblem, clock: CoarseClock, speed: float | None) -> Cause:
    effect = CATALOGUE[LAG_COARSE_CLOCK.id].effect
    step = SizedEffect(TableCandidate(LAG_COARSE_CLOCK.id), clock.step_s)
    return Cause(
        LAG_COARSE_CLOCK.id,
        Size(clock.step_s, clock.low_s, clock.high_s, effect.unit),
        None,
        1.0 - clock.p,
        (),
        None,
        effect.advice,
        calc_table_field_cost(problem.machine, step, speed),
    )


def _find_ground_speed(tables: Sequence[BenchTable]) -> float | None:
    speeds = [s for table in tables if (s := table.find_speed_mps()) is not None]
    return float(np.nanmean(np.concatenate(speeds))) if speeds else None


def list_channels(problem: TableProblem, structure_p: float) -> tuple[Channel, ...]:
    """Return how well the nominal model predicts each channel."""
    out = []
    for channel in dict.fromkeys(piece.channel for piece in problem.pieces):
        inside = [k for k, piece in enumerate(problem.pieces) if piece.channel == channel]
        rows = np.isin(problem.piece, inside)
        observed = np.concatenate([problem.pieces[k].observed for k in inside])
        off = observed - problem.nominal[rows]
        varies = float(np.sum((observed - observed.mean()) ** 2))
        explained = 1.0 - float(np.sum(off**2)) / varies if varies > 0.0 else 0.0
        out.append(
            Channel(
                channel,
                problem.pieces[inside[0]].unit,
                len(off),
                float(off.mean()),
                float(np.sqrt(np.mean(off**2))),
                float(np.sqrt(np.mean(problem.sd[rows] ** 2))),
                max(0.0, explained),
                min(1.0, structure_p),
            )
        )
    return tuple(out)


def find_next_run(problem: TableProblem, judgement: TableVerdict) -> NextRun | None:
    """Return the tests that would separate the rivals; None where nothing is ambiguous."""

    def anywhere(effect: SizedEffect) -> SizedEffect:
        return effect._replace(candidate=effect.candidate._replace(scope=None))

    plan = find_separating_tests(
        problem.machine,
        [
            [
                anywhere(one.effect),
                *(anywhere(r.effect) for r in one.rivals if r.effect is not None),
            ]
            for one in judgement.named
        ],
    )
    if plan is not None:
        return _describe_next_run(plan)
    doubtful = [one.effect.candidate.id for one in judgement.named if one.rivals]
    if not doubtful:
        return None
    return NextRun(
        f"this data cannot tell {', '.join(doubtful)} from something else",
        "repeat this test with three or more settings at which the effect would show",
    )


def plan_rate_change(tables: Sequence[BenchTable], machine: Machine) -> NextRun | None:
    """Return a test with a change between two rates where only starts were measured, because starts
    say nothing about the tube."""
    lags = [table for table in tables if table.kind == "lag"]
    if (
        machine.is_tube_measured
        or not lags
        or any(table.find_running_rows().any() for table in lags)
    ):
        return None
    return NextRun(
        "starts cannot tell whether the stream in the tube carries what falls or each "
        "granule falls singly, "
        "and until that is known no strategy moves the shaft for what is landing",
        f"{make_two_rates_test(machine)} (10 min)",
    )


def _describe_next_run(plan: NextTests) -> NextRun:
    why = f"this data cannot tell {_join_rival_names(plan.pairs)} apart"
    if not plan.tests:
        return NextRun(
            why,
            "no bench test of the program's list separates them at the sizes found; repeat "
            "this test "
            "with ten times as many rows",
        )
    why += f"; the tests planned set them at least {plan.apart_sd:.0f} s.d. apart"
    if plan.unsettled:
        why += "; still open after them: " + ", ".join(
            f"{a.candidate.id} from {b.candidate.id}" for a, b in plan.unsettled
        )
    tests = tuple(f"{test.plan} ({test.minutes:.0f} min)" for test in plan.tests)
    return NextRun(
        why,
        "; then ".join(f"{k}. {test}" for k, test in enumerate(tests, 1)),
        id="+".join(test.id for test in plan.tests),
        minutes=sum(test.minutes for test in plan.tests),
        steps=tuple(step for test in plan.tests for step in test.steps),
        tests=tests,
    )


def _join_rival_names(pairs: Sequence[RivalPair]) -> str:
    return ", ".join(dict.fromkeys(effect.candidate.id for pair in pairs for effect in pair))


def list_findings(
    problem: TableProblem,
    tables: Sequence[BenchTable],
    judgement: TableVerdict,
    retellings: Sequence[DuplicateRows],
) -> tuple[str, ...]:
    """Return findings about the rows; columns that could not be judged come first.

    `tables`: the given tables; `retellings`: the rows that were removed because another table
    repeats them.
    """
    ids = {effect.candidate.id for effect in judgement.effects}
    out = [text for table in tables for text in _describe_unjudged(table)]
    if judgement.verdict == "not_judged":
        out += [
            f"{piece.name}: not judged: no effect within its bounds could have shown in these rows"
            for piece in problem.pieces
        ]
    out += [text for table in tables for text in table.findings]
    for index, piece in enumerate(problem.pieces):
        out += _describe_noise(problem, index, piece)
    out += _describe_labels(problem)
    out += describe_duplicates(compare_lag_series(tables, problem.machine), retellings)
    out += [
        f"{piece.name}: the times heap on multiples of {clock.step_s:.4f} s (mean cosine "
        f"{clock.heaping:.2f}): one "
        f"time may be off by {clock.step_s / 2.0:.3f} s, the mean of many at a setting is not"
        for piece, clock in zip(problem.pieces, problem.clocks, strict=True)
        if clock is not None and clock.shown
    ]
    out += [
        f"{candidate.id} {size:+.3g} holds in the rows of "
        f"{problem.scope_name(candidate.scope)} only"
        for candidate, size in judgement.effects
        if candidate.scope is not None
    ]
    out += _describe_settings(problem, judgement)
    if judgement.named and not judgement.unexplained and judgement.unknown >= MIN_LISTED_PROB:
        out.append(
            "something that no effect describes may be there as well (probability "
            f"{judgement.unknown:.2f})"
        )
    if judgement.unexplained and judgement.nearest is not None:
        near = judgement.nearest.id
        low, high = find_size_bounds(near, problem.machine)
        out.append(
            f"nearest effect: {near}, but its size would have to lie outside {low:g} to {high:g} "
            f"{describe_unit(near, problem.machine)}"
            + (", or be negative" if EFFECT_ROWS[near].only_adds else "")
        )
    if ids & {PLACE_LEVER_ARM.id, PLACE_LATENCY.id}:
        out.append(
            f"a constant extra lag ({LAG_OFFSET.id}) looks like {PLACE_LATENCY.id} in a "
            "place table; a lag "
            "table tells them apart"
        )
    if len(problem.observed) < MIN_REPORTED_ROWS:
        out.append(f"only {len(problem.observed)} rows: only large effects can be shown")
    return tuple(out)


def _describe_unjudged(table: BenchTable) -> list[str]:
    """Return findings about measured columns without a number."""
    return [
        f"{f'{table.path} {name}'.strip()}: not judged: no row has a number"
        for name in LAG_COLUMNS
        if table.kind == "lag"
        and name in table.columns
        and not np.isfinite(table.columns[name]).any()
    ]


def _describe_noise(problem: TableProblem, index: int, piece: MeasuredSeries) -> list[str]:
    """Return findings about outliers, and about settings with more scatter than others."""
    out = []
    noise = problem.noise[index]
    if len(noise.outliers):
        shown = ", ".join(f"{piece.observed[k]:g}" for k in noise.outliers[:MAX_SHOWN_ROWS])
        out.append(
            f"{piece.name}: {len(noise.outliers)} of {len(piece.observed)} rows lie far "
            "from their replicates "
            f"({shown} {piece.unit}) and count only as far as {MAX_ROBUST_SD:g} robust s.d."
        )
    if noise.unequal_p is None or noise.unequal_p >= MAX_UNEQUAL_VARIANCE_P_VALUE:
        return out
    own = problem.setting[problem.piece == index]
    first = int(own.min())
    usual = float(np.median([s for _, _, s in noise.setting_sd]))
    loud = [
        (k, s)
        for k, rows, s in noise.setting_sd
        if s > MIN_SETTING_SCATTER_RATIO * usual and rows > 2
    ]
    loud.sort(key=lambda one: -one[1])
    where = "; ".join(
        f"{_describe_setting(piece, own == k + first)}: {s:.3g}"
        for k, s in loud[:MAX_SHOWN_SETTINGS]
    )
    out.append(
        f"{piece.name}: the scatter is not the same everywhere (p {noise.unequal_p:.2g}): usually "
        f"{usual:.3g} {piece.unit}"
        + (f", at {where}" if where else "")
        + "; rows are weighted accordingly"
    )
    return out


def _describe_labels(problem: TableProblem) -> list[str]:
    out = []
    for piece, one, other, difference, half, p in list_label_contrasts(problem):
        word = "differs from" if p < MAX_LABEL_CONTRAST_P_VALUE else "does not differ from"
        out.append(
            f"{piece.name}: {piece.label_column} {other} {word} {one} beyond the model: "
            f"{difference:+.3g} "
            f"{piece.unit} ({difference - half:+.3g} to {difference + half:+.3g}), p {p:.2g}"
        )
    return out


def _describe_settings(problem: TableProblem, judgement: TableVerdict) -> list[str]:
    """Return findings about a deviation common to the rows of one setting that the model does not
    contain."""
    model = judgement.model or judgement.search.best
    if model.posterior.settings_share < MIN_NAMED_PROB:
        return []
    rest = problem.observed - problem.predict(judgement.effects)
    out = []
    for index, piece in enumerate(problem.pieces):
        inside = problem.piece == index
        setting = problem.setting[inside]
        means = sorted(
            (float(rest[inside][setting == k].mean()), _describe_setting(piece, setting == k))
            for k in np.unique(setting)
        )
        (low, at_low), (high, at_high) = means[0], means[-1]
        out.append(
            f"{piece.name}: settings differ by more than their rows do, and intervals are "
            "wider for it: from "
            f"{low:+.3g} {piece.unit} at {at_low} to {high:+.3g} at {at_high}"
        )
    return out


def _describe_setting(piece: MeasuredSeries, rows: BoolArray) -> str:
    at = int(np.flatnonzero(rows)[0])
    parts = [
        f"{name} {values[at]:g}" for name, values in piece.variables.items() if name != "replicate"
    ]
    return " ".join([*parts, str(piece.group[at])]).strip()


class NextTests(NamedTuple):
    """Plan of tests. `pairs`: rivals that this data cannot separate. `unsettled`: pairs that no
    test of the plan separates."""

    tests: tuple[Experiment[Array], ...]
    pairs: tuple[RivalPair, ...]
    unsettled: tuple[RivalPair, ...]
    # Smallest separation of a settled pair by the tests, in s.d.; None where no test separates any.
    apart_sd: float | None


def find_separating_tests(
    machine: Machine, rivals: Sequence[Sequence[SizedEffect]]
) -> NextTests | None:
    """Return the tests that separate the rivals of each cause, selected by the predicted readings
    under each rival.

    `rivals`: for each ambiguous cause, its members at their fitted sizes. The result is None where
    there is nothing to separate.
    """
    pairs = tuple(
        (a, b) for members in rivals for i, a in enumerate(members) for b in members[i + 1 :]
    )
    if not pairs:
        return None
    every = list_bench_tests(machine)
    readings = {
        effect: [one.predict(add_effects(machine, (effect,))) for one in every]
        for pair in pairs
        for effect in pair
    }
    apart = np.array(
        [
            [float(np.linalg.norm(readings[a][k] - readings[b][k])) for k in range(len(every))]
            for a, b in pairs
        ]
    )
    found = choose_experiments(
        apart, [one.minutes for one in every], SEPARATION_SD, MAX_PLANNED_TESTS
    )
    return NextTests(
        tuple(every[k] for k in found.tests),
        pairs,
        tuple(pair for pair, settled in zip(pairs, found.settled, strict=True) if not settled),
        found.apart_sd,
    )


def calc_table_field_cost(
    machine: Machine, effect: SizedEffect, speed_mps: float | None
) -> FieldCost:
    """Return the error of the rate, %, and of the landing position, m, if control does not
    compensate the effect.

    For an effect of the scale the flow trim is assumed to be on: the machine then follows the wrong
    scale. A lag calculated from distances at a wrong speed is wrong. The cost of the heads' effects
    depends on the crop and is None.
    """
    costs = EFFECT_ROWS[effect.candidate.id].costs
    if costs in COSTS_OUTSIDE_MODEL:
        return COSTS_OUTSIDE_MODEL[costs]
    changed = add_effects(machine, (effect,))
    speed = speed_mps if speed_mps is not None else USUAL_SPEED_MPS
    points = (
        OperatingPoint(
            machine.set_points.shaft_rpm, machine.set_points.opening_mm, machine.flow.full_kg, speed
        ),
    )
    rate = calc_rate_error(machine, points, changed, points)
    learnt_percent = changed.fall.speed_scale_percent - machine.fall.speed_scale_percent
    place = (
        speed * (_calc_start_lag_s(changed) - _calc_start_lag_s(machine))
        + changed.fall.lever_arm_m
        - machine.fall.lever_arm_m
        + speed * _calc_start_lag_s(machine) * learnt_percent / 100.0
    )
    return FieldCost(rate, place)


def _calc_start_lag_s(machine: Machine) -> float:
    """Return the total lag of a start at the set-point, s, for the worst direction."""
    fall, rpm = machine.fall, machine.set_points.shaft_rpm
    return (
        calc_response_s(machine, rpm)
        + find_start_drop_s(fall, rpm)
        + fall.latency_s
        + fall.first_fill_s
        + 0.5 * abs(fall.asymmetry_s)
    )

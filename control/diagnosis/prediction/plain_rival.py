"""Fits the plain rival: a least-squares model without knowledge of effects.

For a drive the rival has a curve (gain, dead zone, saturation, a separate reverse curve), lag and
dead time; for every channel straight lines over the recorded variables, with outlying cells limited
to the range of the others. The fit is least squares over all rows (Tuo and Wu, Annals of Statistics
43, 2015, 2331: where no model is right, the sizes that make the residual most probable are not
those that predict best). The number of parameters is the smallest within one standard error of the
best on held-out blocks. The rival is a machine file as any other: its curve uses the drive's own
parameters, its lines are terms. No part of the rival is a named cause.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import (
    EFFECT_ROWS,
    SHAFT_BACK_GAIN,
    SHAFT_BACK_ZONE,
    SHAFT_DEAD_TIME,
    SHAFT_DEAD_ZONE,
    SHAFT_GAIN,
    SHAFT_NEUTRAL,
    SHAFT_SATURATION,
    SHAFT_SLOW,
    find_size_range,
)
from topdress.control.diagnosis.extend import find_free_id
from topdress.control.diagnosis.judgement.evidence import TWO_SIDED_90_QUANTILE
from topdress.control.diagnosis.runs.drives import Drive, measure_zero_offset
from topdress.control.diagnosis.runs.hypothesis import EffectInstance, Hypothesis
from topdress.control.diagnosis.runs.smooth import DOWNSTREAM_VARIABLES, MIN_RANGE, NOMINAL_RANGES
from topdress.control.machine.machine import (
    CATALOGUE,
    Machine,
    add_effect,
    find_size_bounds,
    list_effect_sizes,
    scale_nominal,
)
from topdress.control.machine.term_form import ANGLES
from topdress.control.machine.term_forms import Form
from topdress.control.machine.terms import (
    COMMANDED_MM,
    COMMANDED_RPM,
    Term,
    TermTarget,
    name_own_command,
)

from .block_errors import (
    SATURATION_ENDS_KEY,
    BlockErrors,
    MachineFileNumber,
    calc_block_errors,
    calc_errors_by_channel,
    calc_gain_by_block,
    calc_number_slopes,
    is_surely_positive,
    list_added_numbers,
    list_term_numbers,
)
from .log_prediction import LogPredictor

Array = npt.NDArray[np.float64]

CURVE_SETS = (
    (SHAFT_GAIN.id,),
    (SHAFT_GAIN.id, SHAFT_DEAD_ZONE.id),
    (SHAFT_GAIN.id, SHAFT_DEAD_ZONE.id, SHAFT_SATURATION.id),
    (SHAFT_GAIN.id, SHAFT_DEAD_ZONE.id, SATURATION_ENDS_KEY),
)
OFF_ZERO_SETS = (
    (SHAFT_GAIN.id, SHAFT_NEUTRAL.id),
    (SHAFT_GAIN.id, SHAFT_NEUTRAL.id, SHAFT_DEAD_ZONE.id),
    # These curves are for shafts that stand at another command than 0.
    (SHAFT_GAIN.id, SHAFT_NEUTRAL.id, SHAFT_SATURATION.id),
)
REVERSE_EFFECTS = (SHAFT_BACK_GAIN.id, SHAFT_BACK_ZONE.id)
DYNAMIC_EFFECTS = (SHAFT_DEAD_TIME.id, SHAFT_SLOW.id)
# Start values of a dead zone, as shares of the full command: 5 to 25 % are usual for motors with
# duty-cycle control.
START_ZONES = (0.05, 0.2)
# Start values of other numbers, as a share of the usual size: inside the bounds, where every slope
# exists.
START_OF_USUAL_SIZE = 0.2
# Difference for a slope, as a share of the usual size.
SLOPE_STEP_OF_USUAL_SIZE = 0.01
# Maximum number of steps of a fit, and of a continued fit.
MAX_FIT_STEPS, MAX_REFIT_STEPS = 25, 6
# Relative tolerance of the error and of the numbers at which a fit has converged.
FIT_TOLERANCE = 1e-4
# Number of classes by which a log's speeds are counted.
SPEED_CLASS_COUNT = 6
# Maximum number of lines of a rival.
MAX_RIVAL_LINES = 3
# Maximum number of steps of the forward selection.
MAX_SELECTION_STEPS = MAX_RIVAL_LINES + 1
# Percentiles of a variable between which its line is valid: single cells lie beyond.
LINE_PERCENTILES = (0.5, 99.5)
# Share of the rows beyond a level of the commands, and the span of the levels as a share of full
# speed, from which a curve is fitted.
LEVEL_SHARE, MIN_SPAN_SHARE = 0.02, 1.0 / 3.0
# Distance from an end of its range, as a share of the range, within which a size stands there.
END_SHARE = 1e-3
# Minimum share of the residual that a line explains.
MIN_RESIDUAL_SHARE_OF_LINE = 1e-3
# Level of a line at its middle for its slope, which is linear in the level.
SLOPE_STEP_OF_LEVEL = 1.0
# Maximum length of a term's id, letters; the rest is for a number where the name is already
# adopted.
MAX_ID_LETTERS = 76
CHANNEL_TARGETS: dict[str, tuple[TermTarget, ...]] = {
    "shaft": (TermTarget.SHAFT_RPM, TermTarget.SHAFT_PERCENT),
    "gate": (TermTarget.GATE_MM,),
    "scale": (TermTarget.FLOW_PERCENT,),
    "speed": (TermTarget.WHEEL_PERCENT,),
}
CHANNEL_STAGES = {"scale": "flow"}


class PlainRival(NamedTuple):
    """The rival of one channel as a machine file. sizes : of effects, with their s.d. terms : its
    lines, the strongest first."""

    machine: Machine
    held: BlockErrors
    sizes: tuple[tuple[str, float, float], ...]
    terms: tuple[Term, ...]

    @property
    def variable_names(self) -> tuple[str, ...]:
        """Return the variables of the lines."""
        return tuple(dict.fromkeys(name for term in self.terms for name in term.variable_names))


def find_rival(on_log: LogPredictor, channel: str) -> PlainRival | None:
    """Fit the rival of a channel; None where no rival is better than the unchanged machine file."""
    if channel not in CHANNEL_TARGETS:
        return None
    nothing = calc_block_errors(on_log, on_log.machine, (channel,), ())
    usual = {channel: nothing.rms[channel] ** 2}
    if usual[channel] <= 0.0:
        return None
    reading = on_log.seen[channel].measured
    own_mean = float(np.var(reading[np.isfinite(reading)]))
    machine, best = on_log.machine, nothing
    lines: list[Term] = []
    curved = channel != "shaft"
    for _ in range(MAX_SELECTION_STEPS):
        tried = None if curved else _choose_drive_curve(on_log, machine, best, usual)
        curved = curved or tried is not None
        if tried is None and len(lines) < MAX_RIVAL_LINES:
            line = _find_best_line(on_log, channel, machine, lines)
            if (
                line is not None
                and (tried := _add_best_line(on_log, channel, machine, line, best, usual))
                is not None
            ):
                lines.append(line)
        if tried is None:
            break
        machine, best = tried
    # A file that predicts worse than the reading's own mean knows nothing of the drive.
    of_drive = channel in ("shaft", "gate")
    if of_drive and float(best.blocks[channel].mean()) > own_mean:
        return None
    if machine is on_log.machine or (
        curved
        and channel == "shaft"
        and not _is_better_over_ranges(
            on_log, channel, machine, on_log.machine, name_own_command(channel, "shaft_rpm"), usual
        )
    ):
        return None
    names = [number.name for number in list_added_numbers(machine, on_log.machine)]
    was, now = list_effect_sizes(on_log.machine), list_effect_sizes(machine)
    sizes = tuple(
        (name, now[name] - was.get(name, CATALOGUE[name].neutral), best.sd[names.index(name)])
        for name in now
        if name in names
    )
    known = {term.id for term in on_log.machine.terms}
    return PlainRival(
        machine, best, sizes, tuple(term for term in machine.terms if term.id not in known)
    )


def _add_best_line(
    on_log: LogPredictor,
    channel: str,
    machine: Machine,
    line: Term,
    best: BlockErrors,
    usual: dict[str, float],
) -> tuple[Machine, BlockErrors] | None:
    """Return a file with a further line and all numbers refitted; None where that is not
    significantly better."""
    tried = machine.model_copy(update={"terms": (*machine.terms, line)})
    try:
        tried = fit_machine_file(on_log, (channel,), tried, MAX_REFIT_STEPS)
    except ValueError:
        return None
    after = calc_block_errors(
        on_log, tried, (channel,), list_added_numbers(tried, on_log.machine), usual
    )
    stands = is_surely_positive(calc_gain_by_block(after, best, usual)) and _is_better_over_ranges(
        on_log,
        channel,
        tried,
        machine,
        name_own_command(CHANNEL_STAGES.get(channel, channel), line.variable_names[0]),
        usual,
    )
    return (tried, after) if stands else None


def _is_better_over_ranges(
    on_log: LogPredictor,
    channel: str,
    machine: Machine,
    without: Machine,
    over: str,
    usual: dict[str, float],
) -> bool:
    """Tell whether a file is significantly better than a simpler file on ranges of a variable that
    its numbers were not fitted to."""
    one, other = (
        calc_block_errors(
            on_log, file, (channel,), list_added_numbers(file, on_log.machine), usual, over
        )
        for file in (machine, without)
    )
    return is_surely_positive(calc_gain_by_block(one, other, usual))


def fit_machine_file(
    on_log: LogPredictor, channels: Sequence[str], machine: Machine, runs: int
) -> Machine:
    """Fit the additional numbers of a file by least squares over all rows, with channels weighed by
    the residual of the log's own file."""
    # scipy.optimize takes three tenths of a second to import, so the import is local.
    from scipy.optimize import least_squares

    numbers = list_added_numbers(machine, on_log.machine)
    weight = {
        name: 1.0 / max(1e-150, float(np.linalg.norm(one)))
        for name, one in calc_errors_by_channel(on_log, on_log.machine, channels).items()
    }
    low, high = np.array([(number.low, number.high) for number in numbers]).T
    start = np.array([number.value for number in numbers])
    scale = np.array([max(number.step, 1e-12) / SLOPE_STEP_OF_USUAL_SIZE for number in numbers])

    def at(values: Array) -> Machine:
        turned = machine
        for number, value in zip(numbers, values.tolist(), strict=True):
            turned = number.turned(turned, value)
        return turned

    def left(values: Array) -> Array:
        return np.concatenate(
            [
                weight[name] * one
                for name, one in calc_errors_by_channel(on_log, at(values), channels).items()
            ]
        )

    def jacobian(values: Array) -> Array:
        there = [
            number._replace(value=float(value))
            for number, value in zip(numbers, values, strict=True)
        ]
        now = at(values)
        columns = calc_number_slopes(
            on_log, now, channels, there, calc_errors_by_channel(on_log, now, channels)
        )
        return -np.concatenate([weight[name] * columns[name] for name in channels])

    found = least_squares(
        left,
        np.clip(start, low + 1e-9, high - 1e-9),
        jacobian,
        (low, high),
        x_scale=scale,
        max_nfev=runs,
        ftol=FIT_TOLERANCE,
        xtol=FIT_TOLERANCE,
    )
    return at(found.x)


# The following functions fit the curve of a drive.


def find_curves(on_log: LogPredictor) -> list[Hypothesis]:
    """Return curves of an open-loop drive with lag and dead time, from few numbers to all, as
    hypotheses.

    Effects that form one curve together hardly show one by one.
    """
    if on_log.data.shaft is None:
        return []
    sets = [names for names in _list_parameter_sets(on_log) if SATURATION_ENDS_KEY not in names]
    was, found = list_effect_sizes(on_log.machine), []
    if any(SHAFT_DEAD_ZONE.id in names for names in sets):
        for names, (_, file) in _fit_parameter_sets(on_log, on_log.machine, sets).items():
            now = list_effect_sizes(file)
            found += [
                tuple(
                    EffectInstance(name, now.get(name, 0.0) - was.get(name, 0.0))
                    for name in names
                    if name not in DYNAMIC_EFFECTS
                )
            ]
    return found


def _choose_drive_curve(
    on_log: LogPredictor, machine: Machine, best: BlockErrors, usual: dict[str, float]
) -> tuple[Machine, BlockErrors] | None:
    """Return the simplest set of the drive's own numbers within one standard error of the best;
    None where no set is significantly better than a file without."""
    tried = [
        (machine, best),
        *(
            (
                file,
                calc_block_errors(
                    on_log, file, ("shaft",), list_added_numbers(file, on_log.machine), usual
                ),
            )
            for _, file in _fit_parameter_sets(
                on_log, machine, _list_parameter_sets(on_log)
            ).values()
        ),
    ]
    least = min(tried, key=lambda one: float(one[1].blocks["shaft"].mean()))
    chosen = next(
        one for one in tried if not is_surely_positive(calc_gain_by_block(least[1], one[1], usual))
    )
    if chosen[0] is machine or not _spans_range(on_log):
        return None
    chosen = _drop_unsure_numbers(on_log, *chosen, usual)
    stands = (
        chosen[0] != machine
        and is_surely_positive(calc_gain_by_block(chosen[1], best, usual))
        and all(
            _is_better_over_ranges(on_log, "shaft", chosen[0], machine, name, usual)
            for name in _list_recorded_columns(on_log)
        )
    )
    return chosen if stands else None


def _spans_range(on_log: LogPredictor) -> bool:
    """Tell whether a log's commands have two levels and span a third of full speed: a curve from
    less holds for that command only."""
    drive = on_log.data.shaft
    if drive is None:
        return False
    low, high = np.quantile(drive.command, (LEVEL_SHARE, 1.0 - LEVEL_SHARE))
    return bool(high - low >= MIN_SPAN_SHARE * on_log.machine.limits.shaft_high_rpm)


def _list_recorded_columns(on_log: LogPredictor) -> list[str]:
    """Return the recorded variables that change and are not downstream of the shaft."""
    never = DOWNSTREAM_VARIABLES["shaft"] | {"time_s"}
    return [
        name
        for name, values in on_log.data.variables.items()
        if name not in never and name in on_log.inputs and np.ptp(values) > 0.0
    ]


def _drop_unsure_numbers(
    on_log: LogPredictor, machine: Machine, errors: BlockErrors, usual: dict[str, float]
) -> tuple[Machine, BlockErrors]:
    """Return a file without the effects whose interval reaches 0 or that stand at the end of their
    search, the others refitted."""
    while True:
        numbers = list_added_numbers(machine, on_log.machine)
        unsure = [
            number
            for number, sd in zip(numbers, errors.sd, strict=True)
            if number.name in CATALOGUE
            and (
                abs(number.value) <= TWO_SIDED_90_QUANTILE * sd
                or _is_at_end(number, on_log.machine)
            )
        ]
        if not unsure:
            return machine, errors
        weakest = min(unsure, key=lambda number: abs(number.value) / max(number.step, 1e-300))
        machine = weakest.turned(machine, 0.0)
        rest = list_added_numbers(machine, on_log.machine)
        if rest:
            machine = fit_machine_file(on_log, ("shaft",), machine, MAX_REFIT_STEPS)
            rest = list_added_numbers(machine, on_log.machine)
        errors = calc_block_errors(on_log, machine, ("shaft",), rest, usual)


def _is_at_end(number: MachineFileNumber, machine: Machine) -> bool:
    """Tell whether a size stands at the end of the catalogue's range: the data want it beyond. A
    time that is as short as can be stands at no end."""
    low, high = find_size_bounds(number.name, machine)
    near = END_SHARE * (high - low)
    return number.value >= high - near or (low < 0.0 and number.value <= low + near)


def _fit_parameter_sets(
    on_log: LogPredictor, machine: Machine, sets: Sequence[tuple[str, ...]]
) -> dict[tuple[str, ...], tuple[float, Machine]]:
    """Fit each set of a drive's own numbers, from few to all, and return the residual sum of
    squares with the file. Each fit starts from the best smaller set."""
    found: dict[tuple[str, ...], tuple[float, Machine]] = {}
    for names in sets:
        _, _, smaller = max(
            ((len(one), -left, one) for one, (left, _) in found.items() if set(one) < set(names)),
            default=(0, 0.0, ()),
        )
        new = [name for name in names if name not in smaller]
        files = []
        for share in START_ZONES if SHAFT_DEAD_ZONE.id in new else START_ZONES[:1]:
            file = _make_starting_machine(
                found[smaller][1] if smaller else machine, on_log.data.shaft, new, share
            )
            try:
                file = fit_machine_file(on_log, ("shaft",), file, MAX_FIT_STEPS)
            # Numbers without a bound may overflow; the sets without them stay.
            except ValueError:
                continue
            files.append(
                (
                    float(np.sum(calc_errors_by_channel(on_log, file, ("shaft",))["shaft"] ** 2)),
                    file,
                )
            )
        if files:
            found[names] = min(files, key=lambda one: one[0])
    return found


def _make_starting_machine(
    machine: Machine, drive: Drive | None, names: Sequence[str], share: float
) -> Machine:
    """Return a file with start values. share : start value of a dead zone as a share of the
    range."""
    for name in names:
        if name == SATURATION_ENDS_KEY:
            assert drive is not None
            half = 0.5 * float(np.max(np.abs(drive.command)))
            knee = Term.model_validate(
                {
                    "id": find_free_id("shaft.knee_shaft_rpm", [term.id for term in machine.terms]),
                    "acts_on": TermTarget.SHAFT_RPM,
                    "form": Form.DEAD_ZONE,
                    "over": [{"name": "shaft_rpm"}],
                    "coefficients": {"slope": -0.5, "low_end": -half, "high_end": half},
                }
            )
            machine = machine.model_copy(update={"terms": (*machine.terms, knee)})
            continue
        low, high = find_size_range(name, machine)
        zone = name == SHAFT_DEAD_ZONE.id
        size = (
            share * machine.limits.shaft_high_rpm
            if zone
            else START_OF_USUAL_SIZE * EFFECT_ROWS[name].scale_to_machine(machine).usual
        )
        machine = add_effect(machine, name, min(high, max(low, size)))
    return machine


def _list_parameter_sets(on_log: LogPredictor) -> list[tuple[str, ...]]:
    """Return names of numbers that are fitted together, from few to all: for a curve no more than
    the number of commanded speeds."""
    drive, machine = on_log.data.shaft, on_log.machine
    assert drive is not None
    speeds = len(np.unique(np.quantile(drive.command, np.linspace(0.0, 1.0, SPEED_CLASS_COUNT))))
    back = REVERSE_EFFECTS if np.min(drive.command) < 0.0 < np.max(drive.command) else ()
    moves = () if drive.settled or speeds < 2 else DYNAMIC_EFFECTS
    curves = CURVE_SETS if machine.shaft.regulated <= 0.0 else CURVE_SETS[:1]
    if machine.shaft.regulated <= 0.0 and measure_zero_offset(drive, machine).off:
        curves = (*curves, *OFF_ZERO_SETS)
    found = [moves] if moves else []
    for curve in curves:
        found += [(*curve, *moves), *([(*curve, *back, *moves)] if back and len(curve) > 1 else [])]
    return sorted(
        dict.fromkeys(one for one in found if len(set(one) - set(moves)) <= speeds), key=len
    )


# The following functions fit straight lines.


def _find_best_line(
    on_log: LogPredictor, channel: str, machine: Machine, before: Sequence[Term]
) -> Term | None:
    """Return the line that explains most of a file's residual; None where no line explains
    enough."""
    left = calc_errors_by_channel(on_log, machine, (channel,))
    known = calc_number_slopes(
        on_log, machine, (channel,), list_added_numbers(machine, on_log.machine), left
    )[channel]
    free = np.linalg.qr(known)[0] if known.shape[1] else np.empty((len(left[channel]), 0))
    rest = left[channel] - free @ (free.T @ left[channel])
    best, most = None, MIN_RESIDUAL_SHARE_OF_LINE * float(np.sum(rest**2))
    numbers = [number.name for number in list_added_numbers(machine, on_log.machine)]
    for term in _list_lines(on_log, channel, before, SHAFT_GAIN.id not in numbers):
        tried = machine.model_copy(update={"terms": (*machine.terms, term)})
        own = list_term_numbers(term)
        columns = calc_number_slopes(
            on_log, tried, (channel,), own, calc_errors_by_channel(on_log, tried, (channel,))
        )[channel]
        columns = columns - free @ (free.T @ columns)
        sizes, *_ = np.linalg.lstsq(columns, rest, rcond=1e-9)
        taken = float(np.sum(rest**2) - np.sum((rest - columns @ sizes) ** 2))
        if taken > most:
            found = dict(
                zip([number.name.rpartition(".")[2] for number in own], sizes.tolist(), strict=True)
            )
            best, most = (
                term.model_copy(update={"coefficients": {**term.coefficients, **found}}),
                taken,
            )
    return best


def _list_lines(
    on_log: LogPredictor, channel: str, before: Sequence[Term], level_open: bool
) -> list[Term]:
    """Return lines over every recorded variable, of a detectable size. level_open : whether no
    other number is their level."""
    stage, machine = CHANNEL_STAGES.get(channel, channel), on_log.machine
    taken = {(term.acts_on, term.variable_names) for term in before}
    never = {
        "time_s",
        *ANGLES,
        COMMANDED_RPM,
        COMMANDED_MM,
        *DOWNSTREAM_VARIABLES[stage],
        *(("shaft_rpm",) if channel == "shaft" else ()),
    }
    found = []
    for name in on_log.inputs:
        values = on_log.inputs.get(name_own_command(stage, name), np.empty(0))
        if name in never or not len(values) or not np.isfinite(values).all():
            continue
        low, middle, high = (
            float(one)
            for one in np.percentile(values, (LINE_PERCENTILES[0], 50.0, LINE_PERCENTILES[1]))
        )
        if not high - low > max(
            1e-9, scale_nominal(machine, NOMINAL_RANGES.get(name, ())) * MIN_RANGE.get(name, 0.0)
        ):
            continue
        level = {"level": SLOPE_STEP_OF_LEVEL} if level_open else {}
        found += [
            _make_line_term(
                machine,
                acts,
                stage,
                name,
                {"slope": 1.0 / (high - low), "at": middle, **level},
                (low, high),
            )
            for acts in CHANNEL_TARGETS[channel]
            if (acts, (name,)) not in taken
        ]
    return found


def _make_line_term(
    machine: Machine,
    acts: TermTarget,
    stage: str,
    name: str,
    coefficients: dict[str, float],
    valid: tuple[float, float],
) -> Term:
    plain = re.sub(r"[^a-z0-9_.]+", "", f"{stage}.line_{name}".lower())[:MAX_ID_LETTERS]
    return Term.model_validate(
        {
            "id": find_free_id(plain, [term.id for term in machine.terms]),
            "acts_on": acts,
            "form": Form.SLOPE,
            "coefficients": coefficients,
            "over": [{"name": name, "valid": valid}],
        }
    )

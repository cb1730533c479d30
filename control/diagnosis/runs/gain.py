"""What putting the model right gains: on blocks of the log that no size was fitted to, and in the closed loop."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.agronomy.crop import Crop
from control.agronomy.noa import Rule
from control.diagnosis.result import Gain
from control.field.job import Job
from control.machine.machine import Machine
from control.machine.planting import Planted
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import Record, simulated_run
from control.simulation.errors import Errors, errors

from .channels import Channel as ChannelOf
from .likelihood import Z90, Column, fitted, problem
from .noise import Noise, coefficients, segments, series_of
from .nuisances import FORM_CHANNEL, Candidate
from .selection import Named
from .smooth import MIN_RANGE, TABLES
from .unexplained import DOWNSTREAM

Array = npt.NDArray[np.float64]

BLOCKS = 8
HELD_OUT = (1, 4, 6)            # of BLOCKS, counted from 0
GAP_S = 10.0                    # on both sides of a block: longer than the fast noise remembers
PIECES_OF_ERROR = 24            # of the held-out rows: each is longer than the noise remembers


def measure_gain(named: Named) -> list[Gain]:
    """Error of each touched channel before and after, on held-out blocks, sizes refitted on the others.

    Low and high: 90 % interval of `after`, from the spread between the held-out pieces.
    """
    if not named.found.parts:
        return []
    group = named.group
    parts = named.found.parts
    found: list[Gain] = []
    slope = group.slopes(parts)
    unit = group.series_columns(parts)
    before, at_fit = group.residual(()), group.residual(parts)
    for channel in group.channels:
        if channel.copies > 1 or not any(channel.name in c.coefficients for c in slope):
            continue
        length = len(channel.measured)
        edges = np.linspace(0, length, BLOCKS + 1).astype(int)
        gap = int(np.ceil(GAP_S / channel.grid.step_s))
        kept = tuple((int(edges[k]), int(edges[k + 1])) for k in range(BLOCKS) if k not in HELD_OUT)
        cut = segments(length, kept)
        plain = channel._replace(cut=cut)
        columns = [c._replace(coefficients={channel.name: coefficients(c_series, cut)})
                   for c, c_series in unit[channel.name]]
        p = problem([plain], {channel.name: coefficients(at_fit[channel.name], cut)}, columns)
        fit = fitted(p, np.arange(len(columns)), named.found.noise)
        change = sum(a * s for a, (c, s) in zip(fit.amplitude, unit[channel.name], strict=True)
                     if c.key.startswith("slope "))
        after = at_fit[channel.name] - change
        pieces = [slice(int(edges[k]) + gap, int(edges[k + 1]) - gap) for k in HELD_OUT]
        name, unit_word, errors_before, errors_after = _judged(channel.name, channel.unit, channel.grid.step_s,
                                                               before[channel.name], after, pieces)
        if not len(errors_after):
            continue
        words = "blocks " + ", ".join(str(k + 1) for k in HELD_OUT) + f" of {BLOCKS}"
        rms_before = float(np.sqrt(np.mean(errors_before ** 2)))
        found.append(_gain(name, f"rmse, {unit_word}", rms_before, errors_after, words))
        fixed = [pair for pair in unit[channel.name] if not pair[0].key.startswith("slope ")]
        for word, others in _instead(named, channel.name):
            left = _corrected(before[channel.name], fixed, others, plain, named.found.noise)
            judged = _judged(channel.name, channel.unit, channel.grid.step_s, before[channel.name], left, pieces)[3]
            found.append(_gain(name, f"rmse, {unit_word}, {word}", rms_before, judged, words))
    return found


def _gain(channel: str, metric: str, before: float, errors_after: Array, held_out: str) -> Gain:
    """Low and high from the spread of the mean square between PIECES_OF_ERROR even pieces of the held-out rows."""
    rms = float(np.sqrt(np.mean(errors_after ** 2)))
    squares = np.array([float(np.mean(piece ** 2)) for piece in np.array_split(errors_after, PIECES_OF_ERROR)
                        if len(piece)])
    sd = float(np.std(squares) / np.sqrt(len(squares))) / max(2.0 * rms, 1e-12)
    return Gain(channel, metric, before, rms, max(0.0, rms - Z90 * sd), rms + Z90 * sd, held_out)


def _instead(named: Named, channel: str) -> list[tuple[str, list[Column]]]:
    """What else might be put in: the best nameless smooth corrector, and the cause that the log speaks least for."""
    group, found = named.group, []
    best: tuple[float, str, list[Column]] | None = None
    for stage in TABLES:
        if FORM_CHANNEL[stage] != channel:
            continue
        for variable in MIN_RANGE:
            columns = [] if variable in DOWNSTREAM[stage] else group.forms(stage, variable)
            if columns:
                p, count = group.compressed((), columns)
                value = fitted(p, np.arange(count + len(columns)), named.null.noise, rounds=1).log_likelihood
                if best is None or value > best[0]:
                    best = (value, variable, columns)
    if best is not None:
        found.append((f"nameless corrector over {best[1]}", best[2]))
    names = {part.id for part in named.found.parts}
    for one in sorted(named.scan, key=lambda f: abs(f.gain)):
        if one.part.id not in names and one.part.size != 0.0 and one.part.onset_s is None:
            column = group.candidate_column((), Candidate(one.part, one.part.size, one.part.size))
            if channel in column.coefficients and column.coefficients[channel].any():
                found.append((f"placebo {one.part.id}", [column]))
                break
    return found


def _corrected(before: Array, fixed: Sequence[tuple[Column, Array]], others: Sequence[Column], plain: ChannelOf,
               noise: dict[str, Noise]) -> Array:
    """The error once `others` are fitted, beside the tolerances, to the blocks of `plain`, and taken off everywhere."""
    name = plain.name
    whole = segments(len(before))
    shapes = [series_of(c.coefficients[name], whole) for c in others]
    columns = [Column(c.key, {name: coefficients(series, plain.cut)}, c.sd, c.mean)
               for c, series in [*fixed, *zip(others, shapes, strict=True)]]
    p = problem([plain], {name: coefficients(before, plain.cut)}, columns)
    amplitude = fitted(p, np.arange(len(columns)), noise).amplitude[len(fixed):]
    return np.asarray(before - sum(a * series for a, series in zip(amplitude, shapes, strict=True)))


def _judged(name: str, unit: str, step_s: float, before: Array, after: Array,
            pieces: Sequence[slice]) -> tuple[str, str, Array, Array]:
    """The scale is judged by what it is read for: flow, over windows of ten seconds."""
    if name != "scale":
        return name, unit, np.concatenate([before[p] for p in pieces]), np.concatenate([after[p] for p in pieces])
    hop = max(1, round(10.0 / step_s))

    def flow(series: Array) -> Array:
        rows = [-(series[p][hop::hop] - series[p][:-hop:hop][:len(series[p][hop::hop])]) / (hop * step_s)
                for p in pieces if p.stop - p.start > 2 * hop]
        return np.concatenate(rows) if rows else np.empty(0)
    return "flow", "kg/s", flow(before), flow(after)


class LoopGain(NamedTuple):
    """Rate and place error in the field of a machine that has the effects: controlled without and with knowing them."""

    before: Errors
    after: Errors


def closed_loop_gain(nominal: Machine, extended: Machine, planted: Sequence[Planted], crop: Crop, rule: Rule, job: Job,
                     seconds: float = 600.0, seed: int = 1, dt_s: float = 0.05) -> LoopGain:
    """Two simulated runs of the same machine with the `planted` effects: the loop knows `nominal`, then `extended`."""
    judged = [_run(nominal, known, planted, crop, rule, job, seconds, seed, dt_s) for known in (nominal, extended)]
    return LoopGain(judged[0], judged[1])


def _run(nominal: Machine, known: Machine, planted: Sequence[Planted], crop: Crop, rule: Rule, job: Job,
         seconds: float, seed: int, dt_s: float) -> Errors:
    job = with_simulated_field(job, nominal)
    record = Record()
    plant = simulated_machine(nominal, job, seed, dt_s, planted)
    for step in simulated_run(plant, control_loop(known, crop, rule, job), seconds):
        record.add(step)
    return errors(record.columns(), record.fired, nominal.geometry.working_width_m, nominal.fall.lever_arm_m)

"""Measures the gain of the corrected model on blocks of the log to which no size was fitted.
`closed_loop` measures the gain in the field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.judgement.evidence import (
    TWO_SIDED_90_QUANTILE,
    Column,
    ColumnRole,
    fit_amplitudes_and_noise,
    make_evidence_problem,
    project_out_fixed,
)
from topdress.control.diagnosis.judgement.noise import Noise, make_series
from topdress.control.diagnosis.judgement.prior import FORM_SHARE
from topdress.control.diagnosis.result import Gain

from .columns import MAX_HALF_WAVES
from .held_out import (
    BLOCK_COUNT,
    HELD_OUT_BLOCKS,
    HeldOut,
    fit_amplitudes,
    hold_out_blocks,
    list_held_out_errors,
)
from .selection import GroupResult
from .smooth import DOWNSTREAM_VARIABLES, STAGE_TABLES, list_stage_variables

Array = npt.NDArray[np.float64]

# Number of pieces of the held-out rows: each is longer than the correlation time of the noise.
ERROR_PIECE_COUNT = 24


def measure_gain(judged: GroupResult) -> list[Gain]:
    """Return the error of each changed channel on held-out blocks, before and after the correction,
    with sizes refitted on the other blocks.

    Low and high are the 90 % interval of `after`, from the spread between the held-out pieces.
    """
    parts, search = judged.found.parts, judged.search
    if not parts:
        return []
    slopes = search.columns.list_slopes(parts)
    columns = search.columns.group_by_channel(parts)
    before, at_fit = search.model.calc_residual(()), search.model.calc_residual(parts)
    found: list[Gain] = []
    for channel in search.model.channels:
        if channel.copies == 1 and any(channel.name in c.coefficients for c in slopes):
            name = channel.name
            found += _measure_channel_gain(
                judged, hold_out_blocks(channel), columns[name], before[name], at_fit[name]
            )
    return found


def _measure_channel_gain(
    judged: GroupResult,
    blocks: HeldOut,
    columns: Sequence[tuple[Column, Array]],
    before: Array,
    at_fit: Array,
) -> list[Gain]:
    """Return the gains of one channel: of the named causes, of the best nameless correction, and of
    a placebo."""
    noise = judged.found.noise
    amplitude = fit_amplitudes(blocks, columns, at_fit, noise)
    change = sum(
        a * s
        for a, (c, s) in zip(amplitude, columns, strict=True)
        if c.label.role is ColumnRole.SLOPE
    )
    name, unit, errors_before, errors_after = list_held_out_errors(blocks, before, at_fit - change)
    if not len(errors_after):
        return []
    words = "blocks " + ", ".join(str(k + 1) for k in HELD_OUT_BLOCKS) + f" of {BLOCK_COUNT}"
    rms_before = float(np.sqrt(np.mean(errors_before**2)))
    found = [_make_gain(name, f"rmse, {unit}", rms_before, errors_after, words)]
    fixed = [pair for pair in columns if pair[0].label.role is not ColumnRole.SLOPE]
    for word, others in _list_substitutes(judged, blocks.whole.name):
        left = _correct_held_out(blocks, fixed, others, before, noise)
        gain = _make_gain(
            name,
            f"rmse, {unit}, {word}",
            rms_before,
            list_held_out_errors(blocks, before, left)[3],
            words,
        )
        found.append(replace(gain, of="placebo" if word.startswith("placebo") else "corrector"))
    return found


def _make_gain(
    channel: str, metric: str, before: float, errors_after: Array, held_out: str
) -> Gain:
    """Build a gain; low and high come from the spread of the mean square between ERROR_PIECE_COUNT
    equal pieces of the held-out rows."""
    rms = float(np.sqrt(np.mean(errors_after**2)))
    squares = np.array(
        [
            float(np.mean(piece**2))
            for piece in np.array_split(errors_after, ERROR_PIECE_COUNT)
            if len(piece)
        ]
    )
    sd = float(np.std(squares) / np.sqrt(len(squares))) / max(2.0 * rms, 1e-12)
    return Gain(
        channel,
        metric,
        before,
        rms,
        max(0.0, rms - TWO_SIDED_90_QUANTILE * sd),
        rms + TWO_SIDED_90_QUANTILE * sd,
        held_out,
    )


def _list_substitutes(judged: GroupResult, channel: str) -> list[tuple[str, list[Column]]]:
    """Return substitutes for the named causes: the best nameless smooth correction, and the cause
    with the least evidence as a placebo."""
    search, found = judged.search, []
    best: tuple[float, str, list[Column]] | None = None
    for stage in STAGE_TABLES:
        if STAGE_TABLES[stage].channel != channel:
            continue
        for variable in list_stage_variables(judged.search.model.data):
            columns = (
                []
                if variable in DOWNSTREAM_VARIABLES[stage]
                else search.columns.forms.list_over_variable(stage, variable)
            )
            if columns:
                p, count = search.columns.compress_hypothesis((), columns)
                value = fit_amplitudes_and_noise(
                    p, np.arange(count + len(columns)), judged.null.noise, rounds=1
                ).log_likelihood
                if best is None or value > best[0]:
                    best = (value, variable, columns)
    if best is not None:
        found.append((f"nameless corrector over {best[1]}", best[2]))
    names = {part.id for part in judged.found.parts}
    for one in sorted(judged.scan, key=lambda f: abs(f.gain)):
        if one.part.id not in names and one.part.size != 0.0 and one.part.onset_s is None:
            column = search.columns.make_candidate_column((), one.part)
            if channel in column.coefficients and column.coefficients[channel].any():
                found.append((f"placebo {one.part.id}", [column]))
                break
    return found


def _correct_held_out(
    blocks: HeldOut,
    fixed: Sequence[tuple[Column, Array]],
    others: Sequence[Column],
    before: Array,
    noise: dict[str, Noise],
) -> Array:
    """Return the error after `others` and the tolerances were fitted to the fitted blocks and
    subtracted everywhere."""
    shapes = [make_series(c.coefficients[blocks.whole.name], blocks.whole.cut) for c in others]
    amplitude = fit_amplitudes(blocks, [*fixed, *zip(others, shapes, strict=True)], before, noise)[
        len(fixed) :
    ]
    return np.asarray(before - sum(a * series for a, series in zip(amplitude, shapes, strict=True)))


def calc_size_spread(one: GroupResult) -> dict[int, float]:
    """Return how much the size of each effect varies over time and over its form's variable: s.d.
    around its mean, by index of the effect.

    Variation from noise is subtracted. Where the time course or the form of an effect differs from
    the catalogue's, a single size is known no better than this.

    For shapes with energies G, of which the rest of the hypothesis leaves A, and their sizes b of
    covariance C, the mean square is (b'Gb - tr(G C A C)) over the energy of the effect's own
    column; the last term is the share of noise. A size that is given at the end of its variable is
    known as well as its form at that end: the prior's share, as far as the log leaves the form
    open.
    """
    columns, found = one.search.columns, one.found
    base = columns.list_columns(found.parts)
    slopes = [k for k, column in enumerate(base) if column.label.role is ColumnRole.SLOPE]
    shapes = [
        shape
        for k in slopes
        for shape in columns.list_time_shapes(base[k], found.parts[base[k].label.part])
    ]
    p = make_evidence_problem(
        columns.model.channels, columns.model.calc_banded_residual(found.parts), [*base, *shapes]
    )
    every, of_base = p.weigh_columns(found.noise).A, np.arange(len(base))
    spread = {}
    for k, at in zip(
        slopes, range(len(base), len(base) + len(shapes), MAX_HALF_WAVES), strict=True
    ):
        own = [
            j
            for j in p.find_indices(ColumnRole.FORM)
            if j < len(base) and base[j].label.part == base[k].label.part
        ]
        square = 0.0
        for places in (np.arange(at, at + MAX_HALF_WAVES), np.array(own, int)):
            energy = every[np.ix_(places, places)]
            beyond = project_out_fixed(
                p, np.setdiff1d(of_base, places), found.noise
            ).select_columns(places)
            sizes = beyond.fit(p.sd[places])
            by_noise = float(np.trace(energy @ sizes.cov @ beyond.A @ sizes.cov))
            square += max(0.0, float(sizes.b @ energy @ sizes.b) - by_noise) / max(
                1e-300, float(every[k, k])
            )
        part = found.parts[base[k].label.part]
        # `sizes` are then the sizes of the effect's form.
        if own and EFFECT_ROWS[part.id].at_end:
            square += (FORM_SHARE * part.size) ** 2 * float(
                np.mean(np.diag(sizes.cov) / p.sd[own] ** 2)
            )
        spread[base[k].label.part] = float(np.sqrt(square))
    return spread

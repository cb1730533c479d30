"""Splits a log into fitted and held-out blocks, and calculates the errors on the held-out
blocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.diagnosis.judgement.evidence import Column, make_evidence_problem
from topdress.control.diagnosis.judgement.gaussian import Array
from topdress.control.diagnosis.judgement.noise import Noise, calc_coefficients, make_segments

from .channels import ChannelSeries

# Number of blocks of a log.
BLOCK_COUNT = 8
# Indices of the held-out blocks.
HELD_OUT_BLOCKS = (1, 4, 6)
# Gap on both sides of a held-out block, s: longer than the correlation time of the fast noise.
BLOCK_MARGIN_S = 10.0
# Window over which the flow is estimated from the scale, s.
FLOW_WINDOW_S = 10.0


class HeldOut(NamedTuple):
    """A channel split into blocks: sizes are fitted to some blocks and judged on pieces of the
    others."""

    whole: ChannelSeries
    # The channel reduced to the fitted blocks.
    fitted: ChannelSeries
    # Pieces of the held-out blocks; empty for a log that is shorter than the gaps.
    pieces: tuple[slice, ...]


def hold_out_blocks(channel: ChannelSeries) -> HeldOut:
    """Split a channel into BLOCK_COUNT blocks and hold out HELD_OUT_BLOCKS."""
    length = len(channel.measured)
    edges = np.linspace(0, length, BLOCK_COUNT + 1).astype(int)
    gap = int(np.ceil(BLOCK_MARGIN_S / channel.grid.step_s))
    kept = tuple(
        (int(edges[k]), int(edges[k + 1])) for k in range(BLOCK_COUNT) if k not in HELD_OUT_BLOCKS
    )
    pieces = (slice(int(edges[k]) + gap, int(edges[k + 1]) - gap) for k in HELD_OUT_BLOCKS)
    return HeldOut(
        channel,
        channel._replace(
            cut=make_segments(length, kept)._replace(weights=channel.cut.weights),
        ),
        tuple(piece for piece in pieces if piece.start < piece.stop),
    )


def fit_amplitudes(
    blocks: HeldOut, columns: Sequence[tuple[Column, Array]], left: Array, noise: dict[str, Noise]
) -> Array:
    """Fit the amplitudes of columns (given with their series) to the fitted blocks, under the noise
    of the whole log.

    Five blocks alone could mistake a constant for a drift.
    """
    name, cut = blocks.whole.name, blocks.fitted.cut
    there = [
        c._replace(coefficients={name: calc_coefficients(series, cut)}) for c, series in columns
    ]
    p = make_evidence_problem([blocks.fitted], {name: calc_coefficients(left, cut)}, there)
    return p.fit_sizes(np.arange(len(there)), noise).b


def list_held_out_errors(
    blocks: HeldOut, before: Array, after: Array
) -> tuple[str, str, Array, Array]:
    """Return name, unit and held-out errors before and after. The scale is judged by the flow that
    it measures, over windows of FLOW_WINDOW_S."""
    channel, pieces = blocks.whole, blocks.pieces
    if channel.name != "scale":
        rows = (
            np.concatenate([np.arange(p.start, p.stop) for p in pieces])
            if pieces
            else np.empty(0, np.int64)
        )
        return channel.name, channel.unit, before[rows], after[rows]
    step_s = channel.grid.step_s
    hop = max(1, round(FLOW_WINDOW_S / step_s))

    def flow(series: Array) -> Array:
        rows = [
            -(series[p][hop::hop] - series[p][:-hop:hop][: len(series[p][hop::hop])])
            / (hop * step_s)
            for p in pieces
            if p.stop - p.start > 2 * hop
        ]
        return np.concatenate(rows) if rows else np.empty(0)

    return "flow", "kg/s", flow(before), flow(after)

"""Blocks of a log that no size is fitted to, and the errors on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.diagnosis.judgement.evidence import Column, make_evidence_problem
from topdress.control.diagnosis.judgement.gaussian import Array
from topdress.control.diagnosis.judgement.noise import Noise, coefficients, make_segments

from .channels import ChannelSeries

BLOCKS = 8
HELD_OUT = (1, 4, 6)  # of BLOCKS, counted from 0
# on both sides of a block: longer than the fast noise remembers
GAP_S = 10.0
# flow is read off the scale over windows of this length
FLOW_S = 10.0


class HeldOut(NamedTuple):
    """One channel cut into blocks: sizes are fitted to some of them and judged on the pieces of
    the others."""

    whole: ChannelSeries
    fitted: ChannelSeries  # the same, cut to the blocks that are fitted
    # of the held-out blocks; none in a log that is shorter than their gaps
    pieces: tuple[slice, ...]


def hold_out_blocks(channel: ChannelSeries) -> HeldOut:
    """A channel cut into BLOCKS, of which HELD_OUT are not fitted to."""
    length = len(channel.measured)
    edges = np.linspace(0, length, BLOCKS + 1).astype(int)
    gap = int(np.ceil(GAP_S / channel.grid.step_s))
    kept = tuple((int(edges[k]), int(edges[k + 1])) for k in range(BLOCKS) if k not in HELD_OUT)
    pieces = (slice(int(edges[k]) + gap, int(edges[k + 1]) - gap) for k in HELD_OUT)
    return HeldOut(
        channel,
        channel._replace(cut=make_segments(length, kept)),
        tuple(piece for piece in pieces if piece.start < piece.stop),
    )


def fit_amplitudes(
    blocks: HeldOut, columns: Sequence[tuple[Column, Array]], left: Array, noise: dict[str, Noise]
) -> Array:
    """Amplitudes of columns (given with their series) fitted to the blocks that are not held
    out, under the noise of the whole: five blocks alone may take a constant for drift."""
    name, cut = blocks.whole.name, blocks.fitted.cut
    there = [c._replace(coefficients={name: coefficients(series, cut)}) for c, series in columns]
    p = make_evidence_problem([blocks.fitted], {name: coefficients(left, cut)}, there)
    return p.sizes(np.arange(len(there)), noise).b


def list_held_out_errors(
    blocks: HeldOut, before: Array, after: Array
) -> tuple[str, str, Array, Array]:
    """Name, unit and held-out errors. The scale is judged by what it is read for: flow, over
    windows of FLOW_S."""
    channel, pieces = blocks.whole, blocks.pieces
    if channel.name != "scale":
        rows = (
            np.concatenate([np.arange(p.start, p.stop) for p in pieces])
            if pieces
            else np.empty(0, np.int64)
        )
        return channel.name, channel.unit, before[rows], after[rows]
    step_s = channel.grid.step_s
    hop = max(1, round(FLOW_S / step_s))

    def flow(series: Array) -> Array:
        rows = [
            -(series[p][hop::hop] - series[p][:-hop:hop][: len(series[p][hop::hop])])
            / (hop * step_s)
            for p in pieces
            if p.stop - p.start > 2 * hop
        ]
        return np.concatenate(rows) if rows else np.empty(0)

    return "flow", "kg/s", flow(before), flow(after)

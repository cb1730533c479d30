"""Blocks of a log that no size is fitted to: where they lie, and that a short log has none."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from control.diagnosis.runs.held_out import BLOCKS, GAP_S, HELD_OUT, held_out


class Steps(NamedTuple):
    step_s: float


class Series(NamedTuple):
    """What `held_out` asks of a channel."""

    measured: np.ndarray
    grid: Steps
    cut: Any = None


@pytest.mark.parametrize("step_s", [0.1, 0.2])
def test_held_out_blocks_keep_their_distance_from_those_that_are_fitted(step_s: float) -> None:
    length, gap = 4800, round(GAP_S / step_s)
    blocks = held_out(Series(np.zeros(length), Steps(step_s)))  # type: ignore[arg-type]
    assert [(piece.start, piece.stop) for piece in blocks.pieces] == [
        (length * k // BLOCKS + gap, length * (k + 1) // BLOCKS - gap) for k in HELD_OUT]


@pytest.mark.parametrize("seconds", [8.0, 80.0, 8.0 * 2.0 * GAP_S])
def test_a_log_shorter_than_the_gaps_holds_nothing_out(seconds: float) -> None:
    blocks = held_out(Series(np.zeros(round(10.0 * seconds)), Steps(0.1)))  # type: ignore[arg-type]
    assert blocks.pieces == ()

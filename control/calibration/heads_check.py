"""Which gain and offset has each canopy head in a run log? Against the joint median of the
others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit
from topdress.control.machine.machine import Adopted, Machine, add_effect

from .bench_table import Array
from .calibration_record import make_record, make_title, merge_records
from .least_squares import FittedInterval

# Length of a block, s: differences of the canopy between heads last a few metres, so that a block
# is worth one value.
BLOCK_S = 10.0
MIN_BLOCKS = 6
# Least number of heads: a median of two blames both.
MIN_HEADS = 3
# Smaller differences are usual between clean heads on a crop, %.
FOULED_HEAD_DIFFERENCE_PERCENT = 1.5
# Bare ground below this NDVI shows no gain.
MIN_NDVI = 0.1


class HeadFit(NamedTuple):
    """Holds the fit of one head. gain_percent: mean reading over the mean of the others' median,
    minus 1. slope, offset: of the line through both; None where the canopy is too uniform to
    separate them."""

    number: int
    gain_percent: FittedInterval
    slope: float | None
    offset: float | None
    samples: int
    fouled: bool


class HeadsFit(NamedTuple):
    heads: tuple[HeadFit, ...]
    silent: tuple[int, ...]
    notes: tuple[str, ...]


def check_heads(
    time_s: Array, ndvi: Array, machine: Machine, data: str, *, date: str = ""
) -> tuple[Machine, HeadsFit]:
    """Checks the heads of a log and returns a copy of the machine with the worst one, and the
    fit.

    A head whose gain differs from 0 by more than 1.5 % with 99 % confidence (shared by all
    heads) is fouled.

    Parameters
    ----------
    time_s : (n,) times, s.
    ndvi : (n, heads); NaN: silent.
    machine : the machine model.
    data, date : of the log, for the record.

    Raises
    ------
    ValueError : in one line, where the log has too few readings."""
    fresh = np.concatenate(([True], (np.diff(ndvi, axis=0) != 0.0).any(axis=1)))
    values, at = ndvi[fresh], time_s[fresh]
    heard = np.isfinite(values).mean(axis=0) if len(values) else np.zeros(ndvi.shape[1])
    spoke = np.flatnonzero(heard > 0.5)
    if len(spoke) < MIN_HEADS:
        raise ValueError(
            f"{data}: {len(spoke)} heads with readings: at least {MIN_HEADS} are needed"
        )
    values = values[:, spoke]
    whole = np.isfinite(values).all(axis=1) & (np.median(values, axis=1) > MIN_NDVI)
    values, at = values[whole], at[whole]
    blocks = np.floor((at - at[0]) / BLOCK_S).astype(np.int64) if len(at) else np.zeros(0, np.int64)
    count = len(np.unique(blocks))
    if count < MIN_BLOCKS:
        raise ValueError(
            f"{data}: {count * BLOCK_S:g} s of readings above NDVI {MIN_NDVI:g}: at least "
            f"{MIN_BLOCKS * BLOCK_S:g} s are needed"
        )
    found: list[HeadFit] = []
    fouled: list[int] = []
    # A fouled head must not judge the others.
    for _ in range(len(spoke)):
        found = [
            _fit_head(int(spoke[k]) + 1, k, values, blocks, len(spoke), fouled)
            for k in range(len(spoke))
        ]
        worst = [head for head in found if head.fouled and head.number - 1 not in fouled]
        if not worst or len(spoke) - len(fouled) <= MIN_HEADS:
            break
        fouled.append(max(worst, key=lambda head: abs(head.gain_percent.value)).number - 1)
    silent = tuple(k + 1 for k in range(ndvi.shape[1]) if k not in spoke)
    fit = HeadsFit(tuple(found), silent, _write_notes(found, silent))
    return _calibrate_machine(machine, fit, data, date), fit


def _fit_head(
    number: int, k: int, values: Array, blocks: npt.NDArray[np.int64], heads: int, fouled: list[int]
) -> HeadFit:
    judges = [j for j in range(values.shape[1]) if j != k and j not in fouled]
    own, others = values[:, k], np.median(values[:, judges], axis=1)
    _, which, sizes = np.unique(blocks, return_inverse=True, return_counts=True)
    means = np.column_stack(
        [np.bincount(which, weights=readings) / sizes for readings in (own, others)]
    )
    gain = float(own.mean() / others.mean() - 1.0)
    off = means[:, 0] / means[:, 1] - 1.0 - gain
    spread = float(off.std(ddof=1) / np.sqrt(len(off)))
    sure = float(stdtrit(len(off) - 1, 1.0 - 0.005 / heads)) * spread
    half = float(stdtrit(len(off) - 1, 0.95)) * spread
    slope = offset = None
    if others.std() > 0.03:
        slope = float(np.cov(own, others)[0, 1] / others.var(ddof=1))
        offset = float(own.mean() - slope * others.mean())
    percent = FittedInterval(100.0 * gain, 100.0 * (gain - half), 100.0 * (gain + half))
    return HeadFit(
        number,
        percent,
        slope,
        offset,
        len(own),
        abs(gain) > sure and abs(percent.value) > FOULED_HEAD_DIFFERENCE_PERCENT,
    )


def _write_notes(heads: list[HeadFit], silent: tuple[int, ...]) -> tuple[str, ...]:
    notes = [f"head {number} is silent" for number in silent]
    fouled = [head.number for head in heads if head.fouled]
    if len(fouled) > 1:
        notes.append(
            f"heads {', '.join(map(str, fouled))} are fouled; the machine file holds one: "
            "the worst. Clean "
            "them all and drive again"
        )
    if not fouled:
        notes.append(
            f"no head is off by more than {FOULED_HEAD_DIFFERENCE_PERCENT:g} % for certain"
        )
    if any(head.slope is None for head in heads):
        notes.append("the canopy is too even to tell gain from offset")
    return tuple(notes)


def _calibrate_machine(machine: Machine, fit: HeadsFit, data: str, date: str) -> Machine:
    fouled = [head for head in fit.heads if head.fouled]
    neutral = machine.model_copy(
        update={"heads": machine.heads._replace(fouled_percent=0.0, fouled_head=0.0)}
    )
    records: tuple[Adopted, ...] = ()
    if fouled:
        worst = max(fouled, key=lambda head: abs(head.gain_percent.value))
        neutral = add_effect(
            neutral, "canopy.head_fouled", round(worst.gain_percent.value, 3), worst.number
        )
        records = (
            make_record(
                "canopy.head_fouled", worst.gain_percent, "%", data, date, {}, worst.number
            ),
        )
    return neutral.model_copy(
        update={
            "adopted": merge_records(machine, records, ("canopy.head_fouled",)),
            "title": make_title(machine, "heads", data, date),
        }
    )

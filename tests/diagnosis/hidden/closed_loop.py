"""A controller that corrects its flow by the scale: it reacts to whatever scale and readings
tell, right or not."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from . import nominal as nom
from .programmes import Drive
from .truth import Columns

Floats = npt.NDArray[np.float64]
LEAST, MOST = 0.75, 1.3  # bounds of the correction
PER_KG_S = nom.FLOW_G_PER_REV_MM / 60_000.0
# a correction depends on the log before it only; the ratio hardly on the commands
ROUNDS = 4


def trimmed(
    drive: Drive, logged: Callable[[Drive], Columns], rng: np.random.Generator
) -> tuple[Drive, Floats]:
    """The drive with the commands that such a controller sends, and its correction (rows,).

    logged: drive -> its log. The correction moves once a window of 45 to 150 s.
    """
    window, share = float(rng.uniform(45.0, 150.0)), float(rng.uniform(0.3, 0.8))
    trim, driven = np.ones(drive.time_s.size), drive
    for _ in range(ROUNDS):
        trim = _correction(logged(driven), driven, window, share)
        driven = _commanded(drive, trim)
    return driven, trim


def _correction(columns: Columns, drive: Drive, window_s: float, share: float) -> Floats:
    """Scale's loss over the loss by the readings, window after window; a window with a refill,
    or with little work, changes nothing."""
    t = drive.time_s
    flow = np.where(
        drive.working, PER_KG_S * np.nan_to_num(columns["shaft_rpm"] * columns["opening_mm"]), 0.0
    )
    told = np.r_[0.0, np.cumsum(flow) * drive.row_s]
    scale, poured = columns["hopper_kg"], np.cumsum(drive.refill_kg_s)
    trim, now = np.ones(t.size), 1.0
    edges = np.searchsorted(t, np.arange(t[0], t[-1], window_s))
    smooth = max(1, round(2.0 / drive.row_s))
    for a, b in pairwise(edges):
        begin, end = np.nanmean(scale[a : a + smooth]), np.nanmean(scale[b - smooth : b])
        expected = told[b] - told[a]
        if poured[b - 1] == poured[max(a - 1, 0)] and expected > 1.5 and np.isfinite(begin - end):
            now += share * (np.clip((begin - end) / expected, 0.5, 1.6) - now)
        trim[b:] = np.round(np.clip(now, LEAST, MOST), 4)
    return trim


def _commanded(drive: Drive, trim: Floats) -> Drive:
    """The same wishes through the corrected flow model, within the drives' bounds and
    resolution."""
    shaft = np.where(drive.speed_first, drive.shaft_rpm_cmd / trim, drive.shaft_rpm_cmd)
    opening = np.where(drive.speed_first, drive.opening_mm_cmd, drive.opening_mm_cmd / trim)
    shaft = np.where(drive.shaft_rpm_cmd > 0, np.clip(shaft, 10.0, 100.0), 0.0)
    return drive._replace(
        shaft_rpm_cmd=np.round(shaft, 1), opening_mm_cmd=np.round(np.clip(opening, 5.0, 60.0), 1)
    )

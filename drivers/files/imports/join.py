"""Files of one machine as one log: by their clocks, or one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import polars as pl

from control.log_row import FILE_BEGINS
from control.recordings.finding import Finding
from drivers.files.imports.convert import US, UTC_US, Converted
from drivers.files.imports.mapping import EVENTS, Join
from drivers.files.imports.trouble import ImportTrouble


class JoinedFiles(NamedTuple):
    """`frame`: `us` from 0 on, `utc_us` where known, log columns. `begins_s`: of each part, in
    the order of `parts`."""

    frame: pl.DataFrame
    parts: tuple[Converted, ...]
    begins_s: tuple[float, ...]
    findings: tuple[Finding, ...]


def joined(parts: Sequence[Converted], join: Join) -> JoinedFiles:
    """Raises ImportTrouble where files that are to follow their clocks overlap."""
    by_clock = _by_clock(parts, join)
    ordered = sorted(parts, key=_first) if by_clock or _one_epoch(parts) else list(parts)
    frames, begins = [], []
    shift = -_first(ordered[0])
    end_us = 0
    for number, part in enumerate(ordered):
        if number and not by_clock:
            shift = end_us + round(join.gap_s * 1e6) - _first(part)
        frame = part.frame
        if part.kind == "utc":
            frame = frame.with_columns(pl.col(US).alias(UTC_US))
        frame = frame.with_columns(pl.col(US) + shift)
        if len(ordered) > 1:
            frame = _marked(frame, part.raw.path.name)
        begins.append(int(frame[US][0]) / 1e6)
        end_us = int(frame[US][-1])
        frames.append(frame)
    findings = []
    if len(ordered) > 1:
        how = "by their times" if by_clock else f"one after the other, {join.gap_s:g} s between"
        findings.append(Finding("joined", f"{len(ordered)} files joined {how}"))
    return JoinedFiles(
        pl.concat(frames, how="diagonal_relaxed"), tuple(ordered), tuple(begins), tuple(findings)
    )


def _by_clock(parts: Sequence[Converted], join: Join) -> bool:
    if len(parts) == 1 or join.order == "runs":
        return False
    ordered = sorted(parts, key=_first)
    overlap = next(
        ((a, b) for a, b in pairwise(ordered) if int(a.frame[US][-1]) >= _first(b)), None
    )
    if overlap is None:
        return join.order == "clock" or _one_epoch(parts)
    if join.order == "clock" or (_one_epoch(parts) and join.order is None):
        a, b = overlap
        raise ImportTrouble(
            b.raw.path,
            f"begins before {a.raw.path.name} ends: allowed are files that follow one "
            "another, or join.order: runs in the import file",
        )
    return False


def _one_epoch(parts: Sequence[Converted]) -> bool:
    return len({part.kind for part in parts}) == 1 and parts[0].kind != "relative"


def _first(part: Converted) -> int:
    return int(part.frame[US][0])


def _marked(frame: pl.DataFrame, name: str) -> pl.DataFrame:
    """An operator's mark in the first row says which file begins."""
    mark = f"{FILE_BEGINS}{name.replace(';', ' ')}"
    if EVENTS not in frame.columns:
        frame = frame.with_columns(pl.lit(None, pl.String).alias(EVENTS))
    first = frame[EVENTS][0]
    return frame.with_columns(frame[EVENTS].scatter(0, f"{first};{mark}" if first else mark))

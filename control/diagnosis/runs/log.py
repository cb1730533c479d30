"""What is odd about the recorded data itself, put right where that is safe and always said."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.log_limits import ANYTHING, stand_for_nothing
from control.log_row import COLUMNS, COMMANDS_HELD, PLAUSIBLE
from control.orders import State

from .further import worth_asking

Array = npt.NDArray[np.float64]

FASTEST_MPS = 9.0           # ground speeds above this, most of the time, are not m/s
KMH_IN_MPS = 3.6
KMH_RATIO = (3.2, 4.0)      # of two speeds, of which one is in km/h
SAME_TIME_S = 1e-6          # rows closer than this repeat a time
GAP_STEPS = 1.5             # of the median: a longer one has rows missing
LONGEST_STEP_S = 600.0      # between rows (median): the slowest staircase of settings stands so long on one of them
SELDOM_STEP_S = 60.0        # ... and few loggers are so slow
MIXED_STEP = 0.25           # off the median by this share, in MIXED_ROWS of the rows: the sample time is mixed
MIXED_ROWS = 0.2
HEADS = tuple(f"ndvi_{k}" for k in range(1, 7))
NEEDED = {
    "shaft": ("shaft_rpm_cmd", "shaft_rpm"),
    "gate": ("opening_mm_cmd", "opening_mm"),
    "flow": ("shaft_rpm", "opening_mm", "hopper_kg"),
    "speed": ("speed_mps", "wheel_speed_mps"),
    "heads": HEADS[:3],
}
NUMBERS = ("shaft_rpm_cmd", "shaft_rpm", "opening_mm_cmd", "opening_mm", "hopper_kg", "supply_v", "pitch_deg",
           "roll_deg", "heading_deg", "speed_mps", "wheel_speed_mps", "work_switch", *HEADS)
# Of the published columns, those that no diagnosis of a log reads: neither the channels nor `rates`.
UNREAD = frozenset(COLUMNS) - {"time_s", *NUMBERS, "events", "state", "lat_deg", "lon_deg", "target_rate_kg_ha",
                               "applied_rate_kg_ha"}
PRINTED_DIGITS = 8          # after the point: logs print three to six, places (which are not read here) eight
MIN_ROWS = 40
MIN_SETTLED = 20            # of settled answers: each is a mean of its own, and a staircase up has as many steps
MOVING_MPS = 0.3            # below, both speeds are held at zero and say nothing of their noise
MAX_HELD_S = 3.0
MIN_KNOWN = 0.5             # of the rows, of a further column
MOST = 1e9                  # a number beyond this is no reading of a machine, in any unit (so are a machine file's) ...
LEAST = 1e-9                # ... and one so small is nothing: its square would be lost next to any other


class Clean(NamedTuple):
    """A run log that can be worked with. Arrays of shape (n,); NaN: not known."""

    time_s: Array
    step_s: float                           # median
    columns: dict[str, Array]
    events: npt.NDArray[Any]                # texts, shape (n,)
    state: npt.NDArray[Any]
    stages: tuple[str, ...]                 # channels that this log can show
    findings: tuple[str, ...]
    further: dict[str, Array] = {}          # numbers beyond the published columns, by name
    held: bool = False                      # each command held until the next row: none is missing between

    @property
    def working(self) -> Array:
        """1 where the log says that the machine works, 0 where not, NaN where it does not say: (n,)."""
        if (self.state != "").any():
            return np.where(self.state == State.WORKING, 1.0, 0.0)
        return np.where(np.isfinite(self.columns["work_switch"]), self.columns["work_switch"] > 0.5, np.nan)

    def has(self, name: str) -> bool:
        return bool(np.isfinite(self.columns[name]).any())


def gate(columns: Mapping[str, npt.NDArray[Any]], has: Callable[[str], bool] = lambda stage: True) -> Clean:
    """The data gate: examines and cleans the columns of a run log (its contract; `time_s` in s, the others optional).

    has : whether the machine has a stage; of those that it has not nothing is looked at, and nothing said.

    Raises ValueError with one plain line where there is no usable time column.
    """
    if "time_s" not in columns:
        raise ValueError("column time_s: missing: a run log needs it")
    findings: list[str] = []
    held = any(COMMANDS_HELD in str(text).split(";") for text in columns.get("events", ()))
    least = MIN_SETTLED if held else MIN_ROWS
    time, order = _times(np.asarray(columns["time_s"], np.float64), least, findings)
    rows = _rows(order, len(columns["time_s"]))
    found: dict[str, Array] = {}
    for name in NUMBERS:
        raw = columns.get(name)
        values = np.full(len(time), np.nan) if raw is None else _readings(np.asarray(raw, np.float64)[rows])
        found[name] = _without_sentinels(name, values, findings)
    _units(found, findings)
    for name in ("shaft_rpm", "opening_mm", "hopper_kg"):
        found[name] = _without_held(name, found[name], float(np.median(np.diff(time))), findings)
    never = ": a scale that never changes is not read"
    found["hopper_kg"] = _unless_still("hopper_kg", found["hopper_kg"], never, findings)
    asked_rpm = float(np.nanmax(np.abs(np.r_[0.0, found["shaft_rpm_cmd"]])))
    if asked_rpm > 0.0 and not np.nansum(np.abs(found["shaft_rpm"])):
        never = f", though up to {asked_rpm:g} r/min were commanded: it never turned, or is not read"
        found["shaft_rpm"] = _unless_still("shaft_rpm", found["shaft_rpm"], never, findings)
    stood = _stood(found)
    if stood and (has("speed") or has("heads")):
        findings.append("the machine stood all the time: its speeds and canopy heads are left out")
    stages = []
    for stage, needed in NEEDED.items():
        if not has(stage) or (stood and stage in ("speed", "heads")):
            continue
        missing = [name for name in needed if np.isfinite(found[name]).sum() < least]
        if missing:
            findings.append(f"stage {stage} is left out: column {missing[0]} is missing or nearly empty")
        else:
            stages.append(stage)
    if "flow" in stages:
        stages.append("scale")
    step = float(np.median(np.diff(time)))
    further = _further(columns, rows, {**found, "time_s": time}, findings)
    events = _texts(columns, "events", order)
    return Clean(time, step, found, events, _texts(columns, "state", order), tuple(stages), tuple(findings), further,
                 held)


def _rows(order: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64] | slice:
    """The rows in order; where that is all as they are, the slice that copies nothing."""
    as_they_are = len(order) == count and bool(np.array_equal(order, np.arange(count)))
    return slice(None) if as_they_are else order


def _further(columns: Mapping[str, npt.NDArray[Any]], rows: npt.NDArray[np.int64] | slice,
             published: Mapping[str, Array], findings: list[str]) -> dict[str, Array]:
    """Columns of numbers that are not of the published ones and change: something may depend on them."""
    found = {}
    for name, raw in columns.items():
        if name in COLUMNS or not np.issubdtype(np.asarray(raw).dtype, np.number):
            continue
        values = _without_sentinels(name, _readings(np.asarray(raw, np.float64)[rows]), findings)
        known = values[np.isfinite(values)]
        if len(known) >= max(MIN_ROWS, MIN_KNOWN * len(values)) and np.ptp(np.percentile(known, (1.0, 99.0))) > 0.0:
            found[name] = values
    kept = worth_asking(found, published)
    findings += kept.said
    return kept.columns


def _times(time: Array, least: int, findings: list[str]) -> tuple[Array, npt.NDArray[np.int64]]:
    finite = np.flatnonzero(np.isfinite(time))
    if len(finite) < len(time):
        findings.append(f"column time_s: {len(time) - len(finite)} rows have no time and are left out")
    order = finite[np.argsort(time[finite], kind="stable")]
    if np.any(np.diff(time[finite]) < 0):
        findings.append("column time_s: times run backwards in places; rows are taken in order of time")
    keep = np.concatenate(([True], np.diff(time[order]) > SAME_TIME_S))
    if not keep.all():
        findings.append(f"column time_s: {int((~keep).sum())} rows repeat a time; the first of each is kept")
    order = order[keep]
    if len(order) < least:
        raise ValueError(f"column time_s: {len(order)} usable rows: at least {least} are needed")
    steps = np.diff(time[order])
    step = float(np.median(steps))
    if step > LONGEST_STEP_S:
        whole_s = time[order[-1]] - time[order[0]]
        raise ValueError(f"column time_s: {len(order)} rows are {step:,.0f} s apart, {whole_s:,.0f} s in all: allowed "
                         f"up to {LONGEST_STEP_S:g} s between rows: are the times in another unit?")
    if step > SELDOM_STEP_S:
        findings.append(f"column time_s: {time[order[-1]] - time[order[0]]:,.0f} s for {len(order)} rows, one each "
                        f"{step:,.0f} s: are the times in another unit?")
    missing = int(np.round(steps / step - 1.0)[steps > GAP_STEPS * step].sum())
    if missing:
        share = 100.0 * missing / (len(order) + missing)
        findings.append(f"column time_s: about {missing} rows are missing ({share:.1f} %)")
    if np.mean(np.abs(steps / step - 1.0) > MIXED_STEP) > MIXED_ROWS:
        findings.append("column time_s: the sample time is mixed; the median is "
                        f"{step:.3g} s, from {steps.min():.3g} to {steps.max():.3g} s")
    return time[order] - time[order[0]], order


def _readings(values: Array) -> Array:
    """Readings that are alike to the last digit that a log prints are one reading: what repeats, and in which steps, is
    evidence, and must not hang on the last bits of a float."""
    with np.errstate(over="ignore"):
        rounded = np.round(values, PRINTED_DIGITS)
    if np.array_equal(rounded, values, equal_nan=True):
        return values                   # as a log prints them: a million rows are not kept twice
    return np.where(np.isfinite(rounded), rounded, values)


def _without_sentinels(name: str, values: Array, findings: list[str]) -> Array:
    infinite, beyond = np.isinf(values), np.isfinite(values) & (np.abs(values) > MOST)
    for marked, what in ((infinite, "are infinite"), (beyond, f"are beyond {MOST:.0e}")):
        if marked.any():
            findings.append(f"column {name}: {int(marked.sum())} cells {what}, which no machine reads: left out")
    values = readable(values)
    marked = stand_for_nothing(values, PLAUSIBLE.get(name, ANYTHING))
    if marked.any():
        shown = float(values[marked][0])
        findings.append(f"column {name}: {int(marked.sum())} cells hold {shown:g}, which stands for a missing value")
        values = np.where(marked, np.nan, values)
    return values


def readable(values: Array) -> Array:
    """Numbers (n,) that a machine can have read; NaN for the others."""
    sane = np.where(np.isfinite(values) & ~(np.abs(values) > MOST), values, np.nan)
    sane[np.abs(sane) < LEAST] = 0.0
    if np.array_equal(sane, values, equal_nan=True) and not np.signbit(values[values == 0.0]).any():
        return values                   # nothing in it was otherwise: a million rows are not kept twice
    return sane


def _units(found: dict[str, Array], findings: list[str]) -> None:
    typical = {}
    for name in ("speed_mps", "wheel_speed_mps"):
        moving = found[name][found[name] > MOVING_MPS]
        typical[name] = float(np.median(moving)) if len(moving) > MIN_ROWS else np.nan
    for name, other in (("speed_mps", "wheel_speed_mps"), ("wheel_speed_mps", "speed_mps")):
        ratio = typical[name] / typical[other] if np.isfinite(typical[other]) else np.nan
        if KMH_RATIO[0] < ratio < KMH_RATIO[1] or (not np.isfinite(ratio) and typical[name] > FASTEST_MPS):
            findings.append(f"column {name}: values look like km/h (median {typical[name]:.1f}); divided by 3.6")
            found[name] = found[name] / KMH_IN_MPS
            return


def _unless_still(name: str, values: Array, why: str, findings: list[str]) -> Array:
    """Readings that are the very same in every row say nothing: no hopper, full or empty, is so quiet."""
    known = values[np.isfinite(values)]
    if len(known) < MIN_ROWS or np.ptp(known) > 0.0:
        return values
    findings.append(f"column {name}: {known[0]:g} in every row{why}: left out")
    return np.full(len(values), np.nan)


def _stood(found: dict[str, Array]) -> bool:
    """Whether it never moved, single outliers apart.

    Then wheel and GNSS show their noise alone, and each head its own piece of canopy.
    """
    known = [found[name] for name in ("speed_mps", "wheel_speed_mps") if np.isfinite(found[name]).any()]
    return bool(known) and all(float(np.nanquantile(speed, 0.98)) < MOVING_MPS for speed in known)


def _without_held(name: str, values: Array, step_s: float, findings: list[str]) -> Array:
    """Readings held through a dropout say nothing new: only the first of an improbably long run of equals is kept.

    A run longer than MAX_HELD_S is no dropout: the cell would be empty by then.
    """
    same = np.concatenate(([False], (values[1:] == values[:-1]) & (values[1:] != 0.0)))
    known = np.isfinite(values)
    share = same.sum() / max(1, known.sum())
    if share == 0.0 or share > 0.5:
        return values
    longest = max(3, int(np.ceil(np.log(0.01 / len(values)) / np.log(min(0.9, share + 1e-4)))))
    starts = np.flatnonzero(~same)
    lengths = np.diff(np.append(starts, len(values)))
    held = np.zeros(len(values), bool)
    odd = (lengths > longest) & (lengths * step_s < MAX_HELD_S)
    for start, length in zip(starts[odd], lengths[odd], strict=True):
        held[start + 1:start + length] = True
    if not held.any():
        return values
    findings.append(f"column {name}: {int(held.sum())} cells only repeat an older reading and are not used")
    return np.where(held, np.nan, values)


def _texts(columns: Mapping[str, npt.NDArray[Any]], name: str, order: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
    raw = columns.get(name)
    if raw is None:
        return np.full(len(order), "", object)
    return np.array(["" if text is None or text != text else str(text) for text in np.asarray(raw, object)[order]],
                    object)

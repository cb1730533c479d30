"""What is odd about the recorded data itself, put right where that is safe and always said."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.log_row import COLUMNS, COMMANDS_HELD
from control.orders import State
from control.recordings.finding import Finding
from control.recordings.mended import mended
from control.recordings.speeds import MOVING_MPS
from control.recordings.times import SELDOM_STEP_S
from control.recordings.values import ANYTHING, as_printed, known, readable, without_held, without_lone

from .recorded_variables import worth_asking

Array = npt.NDArray[np.float64]

LONGEST_STEP_S = 600.0      # between rows (median): the slowest staircase of settings stands so long on one of them
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
EVIDENCE = ("time_s", "lat_deg", "lon_deg")     # what tells the unit of a speed
MIN_ROWS = 40
MIN_SETTLED = 20            # of settled answers: each is a mean of its own, and a staircase up has as many steps
MIN_KNOWN = 0.5             # of the rows, of a further column


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
    read, odd = mended({**{name: np.asarray(columns[name], np.float64) for name in (*EVIDENCE, *NUMBERS)
                           if name in columns}, **_texts_and_further(columns)})
    time = read["time_s"] - read["time_s"][0]
    held = any(COMMANDS_HELD in str(text).split(";") for text in read["events"])
    least = MIN_SETTLED if held else MIN_ROWS
    step = _checked_step(time, least, odd)
    found = {name: readable(as_printed(read[name])) if name in read else np.full(len(time), np.nan) for name in NUMBERS}
    for name in ("shaft_rpm", "opening_mm", "hopper_kg"):
        found[name] = without_held(name, found[name], step, odd)
    for name in ("supply_v", "pitch_deg", "roll_deg"):
        found[name] = without_lone(name, found[name], odd)
    findings = [str(finding) for finding in odd]
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
    further = _further(read, {**found, "time_s": time}, findings)
    return Clean(time, step, found, read["events"], read["state"], tuple(stages), tuple(findings), further, held)


def _texts_and_further(columns: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Events and states as texts, and the numbers that are of no published column: (n,) each."""
    count = len(columns["time_s"])
    texts = {name: np.array(["" if text is None or text != text else str(text)
                             for text in np.asarray(columns[name], object)], object)
             if name in columns else np.full(count, "", object) for name in ("events", "state")}
    return texts | {name: np.asarray(raw, np.float64) for name, raw in columns.items()
                    if name not in COLUMNS and np.issubdtype(np.asarray(raw).dtype, np.number)}


def _further(read: Mapping[str, npt.NDArray[Any]], published: Mapping[str, Array], findings: list[str]
             ) -> dict[str, Array]:
    """Columns of numbers that are not of the published ones and change: something may depend on them."""
    found, odd = {}, list[Finding]()
    for name, raw in read.items():
        if name in COLUMNS:
            continue
        values = without_lone(name, readable(known(name, as_printed(raw), ANYTHING, odd)), odd)
        seen = values[np.isfinite(values)]
        if len(seen) >= max(MIN_ROWS, MIN_KNOWN * len(values)) and np.ptp(np.percentile(seen, (1.0, 99.0))) > 0.0:
            found[name] = values
    kept = worth_asking(found, published)
    findings += [*map(str, odd), *kept.said]
    return kept.columns


def _checked_step(time: Array, least: int, findings: list[Finding]) -> float:
    """The median step from row to row, s. Raises ValueError where rows are too few, or too far apart."""
    if len(time) < least:
        raise ValueError(f"column time_s: {len(time)} usable rows: at least {least} are needed")
    step = float(np.median(np.diff(time)))
    if step > LONGEST_STEP_S:
        raise ValueError(f"column time_s: {len(time)} rows are {step:,.0f} s apart, {time[-1]:,.0f} s in all: allowed "
                         f"up to {LONGEST_STEP_S:g} s between rows: are the times in another unit?")
    if step > SELDOM_STEP_S:
        findings.append(Finding("seldom", f"column time_s: {time[-1]:,.0f} s for {len(time)} rows, one each "
                                f"{step:,.0f} s: are the times in another unit?", "time_s"))
    return step


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

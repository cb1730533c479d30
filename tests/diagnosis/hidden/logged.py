"""What of a run gets into its log: rows left out, columns left out, cells left empty, other row
conventions.

The run is simulated finely whatever is logged, so commands between two rows of a coarse log are
lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .nominal import Physics

if TYPE_CHECKING:
    from .plant import Plant

Floats = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
Columns = dict[str, npt.NDArray[Any]]

# What is not in the log -> columns that it lacks, sensors that are therefore not seen.
LACKS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "no_opening": (("opening_mm", "opening_mm_cmd"), ("gate", "scale")),
    "no_opening_reading": (("opening_mm",), ("gate",)),
    "no_supply": (("supply_v",), ()),
    "no_pitch": (("pitch_deg", "roll_deg"), ()),
    "no_scale": (("hopper_kg",), ("scale",)),
    "no_wheel": (("wheel_speed_mps",), ("speed",)),
    "no_heads": (tuple(f"ndvi_{k}" for k in range(1, 7)), ("heads",)),
    "shaft_only": ((), ("gate", "scale", "speed", "heads")),
    "gate_only": ((), ("shaft", "scale", "speed", "heads")),
    "speed_only": ((), ("shaft", "gate", "scale", "heads")),
}
KEPT_ALONE = {
    "shaft_only": ("time_s", "shaft_rpm_cmd", "shaft_rpm", "supply_v"),
    "gate_only": ("time_s", "opening_mm_cmd", "opening_mm"),
    "speed_only": ("time_s", "speed_mps", "wheel_speed_mps", "pitch_deg"),
}
CONVENTIONS = ("same_row", "in_force", "row_later")
ANSWERS = ("shaft_rpm", "opening_mm", "applied_rate_kg_ha")
COMMANDS = ("shaft_rpm_cmd", "opening_mm_cmd", "target_rate_kg_ha")
_PATCHY = {
    "shaft": ("shaft_rpm",),
    "gate": ("opening_mm",),
    "scale": ("hopper_kg",),
    "speed": ("wheel_speed_mps",),
    "": ("supply_v", "pitch_deg"),
}


class Logged(NamedTuple):
    """`rows`: which rows are written (None: all). `absent`: sensors whose columns are not.
    `empty`: cells that are."""

    rows: Rows | None = None
    absent: tuple[str, ...] = ()
    empty: Mapping[str, npt.NDArray[np.bool_]] = {}

    def seen(self, fresh: Rows, every: int, sensor: str) -> Rows:
        """Of the rows with a new sample (one `every` so many), those that the log shows."""
        if sensor in self.absent:
            return fresh[:0]
        if self.rows is not None:
            fresh = np.unique(self.rows // every * every)
        return fresh if sensor not in self.empty else fresh[~self.empty[sensor][fresh]]

    def doubt(self, plant: Plant, around: Physics, base: Mapping[str, Floats]) -> dict[str, Floats]:
        """How far a prediction from the log's commands may be off (rows,), by sensor: it counts
        as further noise.

        Between rows a command is taken as held, or as straight, whichever happens to be nearer.
        """
        if self.rows is None:
            return {}
        d, rows = plant.drive, self.rows
        last = rows[
            np.maximum(np.searchsorted(rows, np.arange(d.time_s.size), side="right") - 1, 0)
        ]
        ways = []
        for way in (lambda x: x[last], lambda x: np.interp(d.time_s, d.time_s[rows], x[rows])):
            known = type(plant)(
                d._replace(
                    shaft_rpm_cmd=way(d.shaft_rpm_cmd), opening_mm_cmd=way(d.opening_mm_cmd)
                ),
                plant.columns,
            ).run(around)
            ways.append(known)
        out = {k: np.min([np.abs(w[k] - base[k]) for w in ways], axis=0) for k in ("shaft", "gate")}
        flow = np.interp(d.time_s, d.time_s[rows], (base["true_shaft"] * base["true_gate"])[rows])
        gone = np.cumsum(flow - base["true_shaft"] * base["true_gate"]) * d.row_s * 5.5e-3 / 60.0
        gone = gone - np.polyval(np.polyfit(d.time_s, gone, 1), d.time_s)
        return {**out, "scale": np.full(gone.size, gone[rows].std())}


def coarse_rows(count: int, row_s: float, hz: float, rng: np.random.Generator) -> Rows:
    """One row every 1/hz s; some loggers come a little late now and then."""
    every = max(1, round(1.0 / hz / row_s))
    rows = np.arange(int(rng.integers(every)), count, every)
    late = int(rng.choice([0, every // 4]))
    return np.unique(np.minimum(rows + rng.integers(0, late + 1, rows.size), count - 1))


def thinned(rows: Rows, step_s: float, rng: np.random.Generator) -> tuple[Rows, str]:
    """Rows missing here and there, in bursts, or both; and how that is called."""
    how = str(rng.choice(["random", "bursts", "both"]))
    keep = np.ones(rows.size, bool)
    if how != "bursts":
        keep &= rng.random(rows.size) >= rng.uniform(0.03, 0.6)
    if how != "random":
        lost, share = 0, rng.uniform(0.02, 0.3) * rows.size
        while lost < share:
            length = max(1, int(rng.uniform(0.5, 40.0) / step_s))
            at = int(rng.integers(rows.size))
            keep[at : at + length] = False
            lost += length
    keep[0] = keep[-1] = True
    return rows[keep], how


def patches(
    count: int, rng: np.random.Generator
) -> tuple[dict[str, npt.NDArray[np.bool_]], list[str]]:
    """Empty cells by sensor (rows,), and which columns they are in ("" as sensor: a column that
    is only a cause)."""
    sensors = [str(s) for s in rng.choice(list(_PATCHY), int(rng.integers(1, 4)), replace=False)]
    empty = {}
    for sensor in sensors:
        gone = np.zeros(count, bool)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(count))
            gone[at : at + int(rng.uniform(0.02, 0.2) * count)] = True
        empty[sensor] = gone
    return empty, [c for s in sensors for c in _PATCHY[s]]


def written(columns: Columns, logged: Logged, lacks: str = "", convention: str = "") -> Columns:
    """The columns of the whole run as such a logger writes them."""
    rows = logged.rows if logged.rows is not None else np.arange(columns["time_s"].size)
    out = {name: column[rows] for name, column in columns.items()}
    if "events" in out:
        out["events"] = _moved(columns["events"], rows)
    if convention:
        _rewrite(out, columns, rows, convention)
    for sensor, gone in logged.empty.items():
        for name in _PATCHY[sensor]:
            out[name] = np.where(gone[rows], np.nan, out[name])
    if lacks in KEPT_ALONE:
        return {name: out[name] for name in KEPT_ALONE[lacks]}
    return {
        name: column for name, column in out.items() if not lacks or name not in LACKS[lacks][0]
    }


def _rewrite(out: Columns, columns: Columns, rows: Rows, convention: str) -> None:
    """The logs of others: what answers a row's command stands in the same row, or a row later
    than it was measured; or a row holds the command under which it was measured."""
    if convention == "same_row":
        ends = np.r_[rows[1:] - 1, rows[-1]]
        for name in ANSWERS:
            out[name] = columns[name][ends]
    for name in {"in_force": COMMANDS, "row_later": ANSWERS}.get(convention, ()):
        out[name] = np.r_[out[name][:1], out[name][:-1]]


def _moved(events: npt.NDArray[Any], rows: Rows) -> npt.NDArray[Any]:
    """Texts (all rows,) on the rows that are written: an event between two rows is told in the
    next."""
    out = events[rows].copy()
    for k in np.flatnonzero(events != ""):
        at = int(np.searchsorted(rows, k))
        if at < rows.size and rows[at] != k:
            out[at] = events[k] if out[at] == "" else f"{out[at]};{events[k]}"
    return out


def judged(lacks: str, ids: Sequence[str], needs: Mapping[str, tuple[str, ...]]) -> list[str]:
    """Of `ids` those that can be told without what the log lacks. `needs`: id -> sensors and
    columns it is told by."""
    if not lacks:
        return list(ids)
    gone = {*LACKS[lacks][1], *LACKS[lacks][0]}
    if lacks in KEPT_ALONE:
        gone |= {"supply_v", "pitch_deg", "opening_mm", "working"} - set(KEPT_ALONE[lacks])
    return [i for i in ids if not gone & set(needs[i])]

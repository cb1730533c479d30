"""A run log's channels as a report shows them: residuals under any set of effects, and what
they may depend on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.console.reports.binned import (
    Axis,
    Binned,
    bin_rates,
    binned,
    find_memory,
    find_shown_share,
    telling,
)
from topdress.control.diagnosis.prediction.on_log import OnLog
from topdress.control.diagnosis.result import Cause
from topdress.control.diagnosis.runs.channels import ChannelSeries, channels
from topdress.control.diagnosis.runs.drives import Drive
from topdress.control.diagnosis.runs.hypothesis import (
    MAX_SWITCHES,
    EffectInstance,
    list_stages,
    schedule,
)
from topdress.control.diagnosis.runs.log import gate
from topdress.control.diagnosis.runs.model import shape_over_time
from topdress.control.diagnosis.runs.stages import RunData, run_data
from topdress.control.machine.machine import CATALOGUE, Machine
from topdress.control.machine.stage_runner import MOST_STEP_S

Array = npt.NDArray[np.float64]

# rows on either side: what changes more slowly is not the scale's noise
SLOW = 15
AFTER_CHANGE_S = 3.0  # a drive has answered by then
STAGE_OF_VIEW = {
    "shaft": ("shaft",),
    "gate": ("gate",),
    "flow": ("flow", "gate"),
    "scale": ("scale", "flow", "gate"),
    "speed": ("speed",),
    "heads": ("heads",),
    "effort": ("effort", "flow"),
    "gate_effort": ("effort",),
}
RUN_WITH_TIME = ("time_s", "hopper_kg", "moved")
FIRST = {"gate": ("opening_mm",), "speed": ("working", "speed_mps"), "heads": ("head", "ndvi")}
# of what an effect does must time tell beyond what any other axis tells
TIME_MORE = 0.08
# though time may tell as much
OWN_AXIS = {"flow.hopper_head": "hopper_kg", "gate.lost_steps": "moved"}


ROWS_IN_BIN = 6  # of time, at least on average


class View(NamedTuple):
    """One channel. `predict(parts)` is what the machine with these effects would have read,
    (n,) in `unit`."""

    name: str
    quantity: str  # "shaft speed"
    unit: str
    time_s: Array
    measured: Array
    predict: Callable[[tuple[EffectInstance, ...]], Array]
    axes: dict[str, Axis]
    member: npt.NDArray[np.int64] | None = None  # head of each row
    # rows between refills: kg are kept, their rate is shown
    segments: npt.NDArray[np.int64] | None = None
    # what the machine file with what it takes up predicts, (n,)
    of_file: Array | None = None

    @property
    def title(self) -> str:
        return f"{self.quantity}: measured less predicted"

    def residual(self, parts: Sequence[EffectInstance]) -> Array:
        return self.measured - self.predict(self.own(parts))

    def effect(self, parts: Sequence[EffectInstance], part: EffectInstance) -> Array:
        """What one of the effects does to the rows along with the others, (n,)."""
        own = self.own(parts)
        more = self.predict(own) - self.predict(tuple(one for one in own if one != part))
        return more if self.segments is None else np.diff(more, prepend=more[0])

    def means(self, axis: Axis, residual: Array, memory: float) -> Binned:
        """Means of a residual (n,) over an axis; where its rate is shown, in g/s, out of the
        hopper positive."""
        if self.segments is None:
            return binned(axis, residual, memory)
        rates = bin_rates(
            axis, residual, float(np.median(np.diff(self.time_s))), self.segments, memory
        )
        return Binned(rates.at, -1000.0 * rates.mean, 1000.0 * rates.half)

    def even_bins(self, minutes: Array, most: int) -> tuple[Axis, Array]:
        """The rows, at these minutes (n,), by even bins of time, `most` at most: the bin of
        each, and their middles."""
        low, high = float(minutes.min()), float(minutes.max())
        count = max(2, min(most, len(minutes) // ROWS_IN_BIN))
        width = (high - low) / count or 1.0
        index = np.minimum(count - 1, ((minutes - low) / width).astype(int))
        return (
            Axis("", index.astype(float), names=tuple("-" for _ in range(count))),
            np.asarray(low + (np.arange(count) + 0.5) * width, np.float64),
        )

    def memory(self, residual: Array) -> float:
        """Correlation of the residual's neighbouring noise."""
        if self.segments is None:
            return find_memory(residual)
        slow = np.convolve(
            np.pad(residual, SLOW, mode="edge"),
            np.ones(2 * SLOW + 1) / (2 * SLOW + 1),
            mode="valid",
        )
        return find_memory(residual - slow)

    def axis_of(self, part: EffectInstance, effect: Array) -> Axis:
        """The axis along which what the effect does to the rows (n,) shows most."""
        own = self.axes.get(OWN_AXIS.get(part.id, ""))
        if own is not None:
            return own
        best = telling(
            [axis for name, axis in self.axes.items() if name not in RUN_WITH_TIME]
            # at one command all along, time alone moves
            or list(self.axes.values()),
            effect,
        )
        late = telling([self.axes[name] for name in RUN_WITH_TIME if name in self.axes], effect)
        more = 0.0 if part.onset_s is not None else TIME_MORE
        return (
            late if find_shown_share(late, effect) > find_shown_share(best, effect) + more else best
        )

    def own(self, parts: Sequence[EffectInstance]) -> tuple[EffectInstance, ...]:
        """Those effects that this channel can feel, as many beginnings and ends as one run may
        have."""
        kept: list[EffectInstance] = []
        for part in parts:
            if (
                CATALOGUE[part.id].stage in STAGE_OF_VIEW[self.name]
                and len({time_s for one in (*kept, part) for time_s in one.switches})
                <= MAX_SWITCHES
            ):
                kept.append(part)
        return tuple(kept)


def parts_of(causes: Sequence[Cause]) -> tuple[EffectInstance, ...]:
    """Causes as the model takes them; those without a size are left out."""
    found = []
    for cause in causes:
        entry = CATALOGUE.get(cause.id)
        if entry is None or (cause.size.value is None and not entry.effect.onset_only):
            continue
        size = 1.0 if entry.effect.onset_only else float(cause.size.value or 0.0)
        onset_s = (
            cause.size.value if entry.effect.onset_only and cause.onset_s is None else cause.onset_s
        )
        found.append(
            EffectInstance(cause.id, size, onset_s, cause.member, cause.until_s, cause.grows)
        )
    return tuple(found)


def find_view(
    views: Sequence[View], parts: Sequence[EffectInstance], part: EffectInstance
) -> tuple[View, Array] | None:
    """The view of the effect's own stage where it shows there, else the one in which it shows
    most."""
    best: tuple[float, View, Array] | None = None
    for view in views:
        own = view.own(parts)
        if part not in own:
            continue
        effect = view.effect(parts, part)
        z = float(np.sqrt(np.sum(effect**2)) / max(1e-12, float(np.std(view.residual(parts)))))
        z *= 1e6 if view.name == CATALOGUE[part.id].stage else 1.0
        if z > 0.0 and (best is None or z > best[0]):
            best = (z, view, effect)
    return None if best is None else (best[1], best[2])


def run_views(
    columns: Mapping[str, npt.NDArray[Any]],
    machine: Machine,
    file: Machine | None = None,
    of_this_run: tuple[EffectInstance, ...] = (),
) -> tuple[View, ...]:
    """Views of a run log's columns (contract of the run log), in the order of the stages. file
    : the machine file with what it takes up; of_this_run : effects along with it that no file
    takes up.

    Raises ValueError with one line where the log has no usable time column.
    """
    log = gate(columns)
    data = run_data(log, machine)
    found: list[View] = []
    of_file = {} if file is None else OnLog(log, data, machine).predicted(file, parts=of_this_run)
    for name, channel in channels(data, machine).items():
        if name == "scale":
            found.append(_flow(channel, data, machine)._replace(of_file=of_file.get(name)))
        found.append(_view(name, channel, data, machine)._replace(of_file=of_file.get(name)))
    return tuple(found)


def _predictor(
    channel: ChannelSeries, machine: Machine
) -> Callable[[tuple[EffectInstance, ...]], Array]:
    base = list_stages(machine)
    known: dict[tuple[EffectInstance, ...], Array] = {}

    def _grown(part: EffectInstance) -> Array:
        """What grows is no switch of the schedule: what it would do all along, weighted with
        its course."""
        whole = channel.predict(
            schedule(base, (EffectInstance(part.id, part.size, member=part.member),)), MOST_STEP_S
        )
        return shape_over_time(
            whole - channel.predict(schedule(base, ()), MOST_STEP_S), channel, part
        )

    def predict(parts: tuple[EffectInstance, ...]) -> Array:
        if parts not in known:
            steady = channel.predict(schedule(base, parts), MOST_STEP_S)
            known[parts] = steady + sum(_grown(part) for part in parts if part.grows)
        return known[parts]

    return predict


def _view(name: str, channel: ChannelSeries, data: RunData, machine: Machine) -> View:
    titles = {
        "shaft": "shaft speed",
        "gate": "opening",
        "scale": "scale reading",
        "speed": "wheel less GNSS speed",
        "heads": "head less the mean of all heads",
        "effort": "effort of the shaft's drive",
        "gate_effort": "effort of the gate's drive",
    }
    copies = channel.copies
    time_s = np.tile(channel.grid.even_s, copies)
    axes = _recorded(data, time_s)
    member = None
    drive = data.shaft if name == "shaft" else data.gate if name == "gate" else None
    if drive is not None:
        axes = {**axes, **_after_changes(drive, channel.grid.even_s)}
    if name == "speed" and data.speed is not None:
        axes["working"] = Axis(
            "working",
            np.round(np.interp(time_s, data.speed.time_s, data.speed.working)),
            names=("out of work", "in work"),
        )
        gained = np.gradient(data.speed.true_mps, data.speed.time_s)
        axes["gain_of_speed"] = Axis("gain_of_speed", np.interp(time_s, data.speed.time_s, gained))
    if name == "heads" and data.heads is not None:
        used = np.flatnonzero(np.isfinite(data.heads.ndvi).any(axis=1))
        member = np.repeat(used + 1, len(channel.grid.even_s))
        heads = tuple(str(k + 1) for k in range(used.max() + 1))
        axes = {
            "head": Axis("head", member.astype(float) - 1.0, names=heads),
            "ndvi": Axis("ndvi", np.tile(channel.grid.of(data.heads.mean), copies)),
            **axes,
        }
    return View(
        name,
        titles[name],
        channel.unit,
        time_s,
        channel.measured,
        _predictor(channel, machine),
        _ordered(axes, name),
        member,
    )


def _recorded(data: RunData, time_s: Array) -> dict[str, Axis]:
    return {
        name: Axis(
            name, time_s / 60.0 if name == "time_s" else np.interp(time_s, data.time_s, values)
        )
        for name, values in data.variables.items()
        if name == "time_s" or np.nanmax(values) > np.nanmin(values)
    }


def _ordered(axes: dict[str, Axis], view: str) -> dict[str, Axis]:
    """Of axes that tell as much the first is taken: the channel's own stands there."""
    first = {name: axes[name] for name in FIRST.get(view, ()) if name in axes}
    return {**first, **{name: axis for name, axis in axes.items() if name not in first}}


def _after_changes(drive: Drive, time_s: Array) -> dict[str, Axis]:
    """Seconds since the command changed, turned by the way it went; the way itself; the
    distance moved so far."""
    change = np.diff(drive.command, prepend=drive.command[0])
    change[~np.isfinite(change)] = 0.0
    rows = np.flatnonzero(np.abs(change) > 1e-9)
    if not len(rows):
        return {}
    newest = np.searchsorted(drive.time_s[rows], time_s, side="right") - 1
    since = np.where(newest >= 0, time_s - drive.time_s[rows][np.maximum(newest, 0)], np.nan)
    way = np.where(newest >= 0, np.sign(change[rows])[np.maximum(newest, 0)], 0.0)
    moved = np.interp(time_s, drive.time_s, np.cumsum(np.abs(change)))
    ways = ("slowing down", "speeding up") if drive.name == "shaft" else ("closing", "opening")
    found = {
        "way": Axis("way", np.where(way == 0.0, np.nan, 0.5 * (way + 1.0)), names=ways),
        "since_change": Axis("since_change", np.where(since < AFTER_CHANGE_S, since, np.nan), way),
    }
    if drive.name == "gate":
        found["moved"] = Axis("moved", moved)
    return found


def _flow(channel: ChannelSeries, data: RunData, machine: Machine) -> View:
    """Flow read off the scale: the same kg, of which the rate is shown."""
    time_s = channel.grid.even_s
    jumps = data.hopper.jumps if data.hopper is not None else ()
    starts = [data.hopper.time_s[jump] for jump in jumps] if data.hopper is not None else []
    segments = np.searchsorted(np.array(starts), time_s, side="right").astype(np.int64)
    return View(
        "flow",
        "flow, read off the scale",
        "g/s",
        time_s,
        channel.measured,
        _predictor(channel, machine),
        _ordered(_recorded(data, time_s), "flow"),
        None,
        segments,
    )

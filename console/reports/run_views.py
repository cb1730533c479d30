"""How does a report show the channels of a run log? Each view has residuals under any set of
effects, and the variables on which they may depend.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.console.reports.binned_means import (
    BinnedMeans,
    ResidualAxis,
    calc_binned_means,
    calc_binned_rates,
    calc_correlation,
    calc_shown_share,
    find_telling_axis,
)
from topdress.control.diagnosis.prediction.log_prediction import LogPredictor
from topdress.control.diagnosis.result import Cause
from topdress.control.diagnosis.runs.channels import ChannelSeries, make_channels
from topdress.control.diagnosis.runs.drives import Drive
from topdress.control.diagnosis.runs.hypothesis import (
    MAX_SWITCHES,
    EffectInstance,
    list_stages,
    make_schedule,
)
from topdress.control.diagnosis.runs.log import clean_run_log
from topdress.control.diagnosis.runs.model import shape_over_time
from topdress.control.diagnosis.runs.stages import RunData, make_run_data
from topdress.control.machine.machine import CATALOGUE, Machine
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

Array = npt.NDArray[np.float64]

# Number of rows on either side of a running mean; slower changes are not the scale's noise.
SLOW_WINDOW_ROWS = 15
# Time by which a drive has settled, s.
SETTLING_TIME_S = 3.0
VIEW_STAGES = {
    "shaft": ("shaft",),
    "gate": ("gate",),
    "flow": ("flow", "gate"),
    "scale": ("scale", "flow", "gate"),
    "speed": ("speed",),
    "heads": ("heads",),
    "effort": ("effort", "flow"),
    "gate_effort": ("effort",),
}
COLUMNS_THAT_GROW_WITH_TIME = ("time_s", "hopper_kg", "moved")
FIRST_AXES = {"gate": ("opening_mm",), "speed": ("working", "speed_mps"), "heads": ("head", "ndvi")}
# Share of an effect that time must explain beyond every other axis.
MIN_TIME_GAIN = 0.08
# These axes are preferred, although time may explain as much.
OWN_AXES = {"flow.hopper_head": "hopper_kg", "gate.lost_steps": "moved"}


# Mean number of rows in a bin of time.
MIN_ROWS_IN_BIN = 6


class ChannelView(NamedTuple):
    """Holds one channel. `predict(parts)` returns the readings of the machine with these effects,
    (n,) in `unit`."""

    name: str
    # Name such as "shaft speed".
    quantity: str
    unit: str
    time_s: Array
    measured: Array
    predict: Callable[[tuple[EffectInstance, ...]], Array]
    axes: dict[str, ResidualAxis]
    # Number of the head of each row.
    member: npt.NDArray[np.int64] | None = None
    # Rows between refills; the mass in kg is stored, its rate is shown.
    segments: npt.NDArray[np.int64] | None = None
    # Prediction (n,) of the machine file with the effects that it adopts.
    of_file: Array | None = None

    @property
    def title(self) -> str:
        """Title of the residual."""
        return f"{self.quantity}: measured less predicted"

    def calc_residual(self, parts: Sequence[EffectInstance]) -> Array:
        """Returns measured minus predicted under these effects, (n,)."""
        return self.measured - self.predict(self.select_own_parts(parts))

    def calc_part_effect(self, parts: Sequence[EffectInstance], part: EffectInstance) -> Array:
        """Returns the effect of one of the parts on the rows in combination with the
        others, (n,)."""
        own = self.select_own_parts(parts)
        more = self.predict(own) - self.predict(tuple(one for one in own if one != part))
        return more if self.segments is None else np.diff(more, prepend=more[0])

    def calc_axis_means(self, axis: ResidualAxis, residual: Array, memory: float) -> BinnedMeans:
        """Returns means of a residual (n,) over an axis; for a mass its rate, in g/s, positive out
        of the hopper."""
        if self.segments is None:
            return calc_binned_means(axis, residual, memory)
        rates = calc_binned_rates(
            axis, residual, float(np.median(np.diff(self.time_s))), self.segments, memory
        )
        return BinnedMeans(rates.at, -1000.0 * rates.mean, 1000.0 * rates.half)

    def make_even_bins(self, minutes: Array, most: int) -> tuple[ResidualAxis, Array]:
        """Returns the rows, at these minutes (n,), in equal bins of time, at most `most`: the bin
        of each row, and the middles."""
        low, high = float(minutes.min()), float(minutes.max())
        count = max(2, min(most, len(minutes) // MIN_ROWS_IN_BIN))
        width = (high - low) / count or 1.0
        index = np.minimum(count - 1, ((minutes - low) / width).astype(int))
        return (
            ResidualAxis("", index.astype(float), names=tuple("-" for _ in range(count))),
            np.asarray(low + (np.arange(count) + 0.5) * width, np.float64),
        )

    def calc_noise_memory(self, residual: Array) -> float:
        """Returns the autocorrelation of the residual's noise."""
        if self.segments is None:
            return calc_correlation(residual)
        slow = np.convolve(
            np.pad(residual, SLOW_WINDOW_ROWS, mode="edge"),
            np.ones(2 * SLOW_WINDOW_ROWS + 1) / (2 * SLOW_WINDOW_ROWS + 1),
            mode="valid",
        )
        return calc_correlation(residual - slow)

    def find_effect_axis(self, part: EffectInstance, effect: Array) -> ResidualAxis:
        """Returns the axis along which the effect on the rows (n,) is most visible."""
        own = self.axes.get(OWN_AXES.get(part.id, ""))
        if own is not None:
            return own
        best = find_telling_axis(
            [axis for name, axis in self.axes.items() if name not in COLUMNS_THAT_GROW_WITH_TIME]
            # With a constant command only time varies.
            or list(self.axes.values()),
            effect,
        )
        late = find_telling_axis(
            [self.axes[name] for name in COLUMNS_THAT_GROW_WITH_TIME if name in self.axes], effect
        )
        more = 0.0 if part.onset_s is not None else MIN_TIME_GAIN
        return (
            late if calc_shown_share(late, effect) > calc_shown_share(best, effect) + more else best
        )

    def select_own_parts(self, parts: Sequence[EffectInstance]) -> tuple[EffectInstance, ...]:
        """Returns the effects that this channel can show, with at most the number of onsets that
        one run may have."""
        kept: list[EffectInstance] = []
        for part in parts:
            if (
                CATALOGUE[part.id].stage in VIEW_STAGES[self.name]
                and len({time_s for one in (*kept, part) for time_s in one.switches})
                <= MAX_SWITCHES
            ):
                kept.append(part)
        return tuple(kept)


def list_effect_instances(causes: Sequence[Cause]) -> tuple[EffectInstance, ...]:
    """Returns causes as the model takes them; causes without a size are omitted."""
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
    views: Sequence[ChannelView], parts: Sequence[EffectInstance], part: EffectInstance
) -> tuple[ChannelView, Array] | None:
    """Returns the view of the effect's own stage if the effect is visible in it, else the view in
    which it is most visible."""
    best: tuple[float, ChannelView, Array] | None = None
    for view in views:
        own = view.select_own_parts(parts)
        if part not in own:
            continue
        effect = view.calc_part_effect(parts, part)
        z = float(np.sqrt(np.sum(effect**2)) / max(1e-12, float(np.std(view.calc_residual(parts)))))
        z *= 1e6 if view.name == CATALOGUE[part.id].stage else 1.0
        if z > 0.0 and (best is None or z > best[0]):
            best = (z, view, effect)
    return None if best is None else (best[1], best[2])


def make_run_views(
    columns: Mapping[str, npt.NDArray[Any]],
    machine: Machine,
    file: Machine | None = None,
    of_this_run: tuple[EffectInstance, ...] = (),
) -> tuple[ChannelView, ...]:
    """Returns views of a run log's columns (contract of the run log), in the order of the stages.

    `file` is the extended machine file, `of_this_run` are further effects that no file adopts.
    Raises ValueError with one line for a log without a usable time column.
    """
    log = clean_run_log(columns)
    data = make_run_data(log, machine)
    found: list[ChannelView] = []
    of_file = (
        {} if file is None else LogPredictor(log, data, machine).predict(file, parts=of_this_run)
    )
    for name, channel in make_channels(data, machine).items():
        if name == "scale":
            found.append(
                _make_flow_view(channel, data, machine)._replace(of_file=of_file.get(name))
            )
        found.append(
            _make_channel_view(name, channel, data, machine)._replace(of_file=of_file.get(name))
        )
    return tuple(found)


def _make_predictor(
    channel: ChannelSeries, machine: Machine
) -> Callable[[tuple[EffectInstance, ...]], Array]:
    base = list_stages(machine)
    known: dict[tuple[EffectInstance, ...], Array] = {}

    def _calc_grown_effect(part: EffectInstance) -> Array:
        """What grows is no switch of the schedule: what it would do all along, weighted with
        its course."""
        whole = channel.predict(
            make_schedule(base, (EffectInstance(part.id, part.size, member=part.member),)),
            MAX_MODEL_STEP_S,
        )
        return shape_over_time(
            whole - channel.predict(make_schedule(base, ()), MAX_MODEL_STEP_S), channel, part
        )

    def predict_with(parts: tuple[EffectInstance, ...]) -> Array:
        if parts not in known:
            steady = channel.predict(make_schedule(base, parts), MAX_MODEL_STEP_S)
            known[parts] = steady + sum(_calc_grown_effect(part) for part in parts if part.grows)
        return known[parts]

    return predict_with


def _make_channel_view(
    name: str, channel: ChannelSeries, data: RunData, machine: Machine
) -> ChannelView:
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
    axes = _list_recorded_axes(data, time_s)
    member = None
    drive = data.shaft if name == "shaft" else data.gate if name == "gate" else None
    if drive is not None:
        axes = {**axes, **_make_change_axes(drive, channel.grid.even_s)}
    if name == "speed" and data.speed is not None:
        axes["working"] = ResidualAxis(
            "working",
            np.round(np.interp(time_s, data.speed.time_s, data.speed.working)),
            names=("out of work", "in work"),
        )
        gained = np.gradient(data.speed.true_mps, data.speed.time_s)
        axes["gain_of_speed"] = ResidualAxis(
            "gain_of_speed", np.interp(time_s, data.speed.time_s, gained)
        )
    if name == "heads" and data.heads is not None:
        used = np.flatnonzero(np.isfinite(data.heads.ndvi).any(axis=1))
        member = np.repeat(used + 1, len(channel.grid.even_s))
        heads = tuple(str(k + 1) for k in range(used.max() + 1))
        axes = {
            "head": ResidualAxis("head", member.astype(float) - 1.0, names=heads),
            "ndvi": ResidualAxis(
                "ndvi", np.tile(channel.grid.interpolate(data.heads.mean), copies)
            ),
            **axes,
        }
    return ChannelView(
        name,
        titles[name],
        channel.unit,
        time_s,
        channel.measured,
        _make_predictor(channel, machine),
        _sort_axes(axes, name),
        member,
    )


def _list_recorded_axes(data: RunData, time_s: Array) -> dict[str, ResidualAxis]:
    return {
        name: ResidualAxis(
            name, time_s / 60.0 if name == "time_s" else np.interp(time_s, data.time_s, values)
        )
        for name, values in data.variables.items()
        if name == "time_s" or np.nanmax(values) > np.nanmin(values)
    }


def _sort_axes(axes: dict[str, ResidualAxis], view: str) -> dict[str, ResidualAxis]:
    """Returns the axes in the order of preference. The channel's own axis comes first, because the
    first of equally telling axes is chosen."""
    first = {name: axes[name] for name in FIRST_AXES.get(view, ()) if name in axes}
    return {**first, **{name: axis for name, axis in axes.items() if name not in first}}


def _make_change_axes(drive: Drive, time_s: Array) -> dict[str, ResidualAxis]:
    """Returns seconds since the command changed, signed by its direction; the direction; and the
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
        "way": ResidualAxis("way", np.where(way == 0.0, np.nan, 0.5 * (way + 1.0)), names=ways),
        "since_change": ResidualAxis(
            "since_change", np.where(since < SETTLING_TIME_S, since, np.nan), way
        ),
    }
    if drive.name == "gate":
        found["moved"] = ResidualAxis("moved", moved)
    return found


def _make_flow_view(channel: ChannelSeries, data: RunData, machine: Machine) -> ChannelView:
    """Returns the flow from the scale: the mass in kg, of which the rate is shown."""
    time_s = channel.grid.even_s
    jumps = data.hopper.jumps if data.hopper is not None else ()
    starts = [data.hopper.time_s[jump] for jump in jumps] if data.hopper is not None else []
    segments = np.searchsorted(np.array(starts), time_s, side="right").astype(np.int64)
    return ChannelView(
        "flow",
        "flow, read off the scale",
        "g/s",
        time_s,
        channel.measured,
        _make_predictor(channel, machine),
        _sort_axes(_list_recorded_axes(data, time_s), "flow"),
        None,
        segments,
    )

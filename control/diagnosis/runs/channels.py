"""Predicts each channel through the machine model and calculates what the prediction leaves of the
measurement.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import fdtrc
from topdress.control.diagnosis.judgement import noise as noises
from topdress.control.diagnosis.judgement.checks import FALSE_ALARM_PROB
from topdress.control.diagnosis.judgement.noise import (
    NoisePrior,
    Segments,
    make_segments,
    merge_bands,
)
from topdress.control.diagnosis.judgement.noise_fit import BAND_DOF
from topdress.control.machine.compiled import (
    run_flow,
    run_flutes,
    run_gate,
    run_gate_effort,
    run_heads,
    run_scale,
    run_shaft,
    run_shaft_effort,
    run_speed,
)
from topdress.control.machine.effect import HOPPER_CAPACITY
from topdress.control.machine.effort import EffortInput
from topdress.control.machine.flow import FlowInput, FlowOutput, make_flow_start
from topdress.control.machine.gate import GateInput, GateOutput, make_gate_start
from topdress.control.machine.heads import HeadInput
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.scale import ScaleInput
from topdress.control.machine.shaft import (
    Shaft,
    ShaftInput,
    ShaftOutput,
    calc_dead_time_s,
    calc_time_constant_s,
    make_shaft_start,
)
from topdress.control.machine.speed import SpeedInput, SpeedOutput, make_speed_start
from topdress.control.machine.stage_runner import (
    MAX_MODEL_STEP_S,
    MIN_STEPS_PER_ROW,
    make_input_rows,
)

from .drives import SETTLE_S, START_SETTLE_TAUS, Drive
from .effort import DriveEffort
from .grid import Grid, join_clock
from .hopper import Hopper
from .hypothesis import MAX_SWITCHES, Schedule, list_stages, make_schedule
from .speed_and_heads import HeadContrasts, TwoSpeeds
from .stages import RunData

Array = npt.NDArray[np.float64]
# Time step of the speed stage, s: the true speed changes between two readings.
SPEED_STEP_S = 0.025
# Maps a schedule and a model step, s, to two series (n, 2) at the log's rows.
RowPredictor = Callable[[Schedule, float], Array]
# Maximum number of refills of one log that the model simulates.
MAX_REFILLS = 4
# A gap between readings longer than this, s, times MAX_BRIDGED_STEPS separates two windows.
SEAM_S = 20.0
# Free mass in the model's hopper above the highest reading, kg, on the nominal machine.
HEADROOM_KG = 5.0
# Share and relative spread of the slow noise component where a channel has none: a negligible
# share, known well.
NEGLIGIBLE_DRIFT, NEGLIGIBLE_SPREAD = 0.01, 0.1
# Number of readings that tell where a drive stands at first: an outlier among them is no matter.
FIRST_READINGS = 3
# Correlation time, s, that represents white noise.
WHITE_TIME_S = 0.02

# Longest period of a speed sensor's narrowband noise, s: longer periods may be the ground's.
MAX_NOISE_PERIOD_S = 4.5
# A damped oscillation spreads to this multiple of its period.
PERIOD_SPREAD = 1.5
# Number of neighbouring bands on either side, an octave and more: a single line does not change
# their median.
NEIGHBOUR_BANDS = 4


class ChannelSeries(NamedTuple):
    """A measured series on its even grid, with the function that predicts the series from the
    model."""

    name: str
    unit: str
    # Measured values, (m,).
    measured: Array
    # Maps a schedule and a model step, s, to the predicted series (m,).
    predict: Callable[[Schedule, float], Array]
    grid: Grid
    cut: Segments
    prior: NoisePrior
    # Number of series that are stacked in this channel (canopy heads).
    copies: int = 1
    # Whether each sample is the settled answer to its command.
    settled: bool = False


def list_parameter_switches(
    plan: Schedule, stage: str, time_s: Array
) -> tuple[tuple[Any, ...], npt.NDArray[np.int64]]:
    """Return the parameter sets of one stage and the rows from which each is in force, padded to
    MAX_SWITCHES + 1."""
    sets = [one.by_name[stage] for one in plan.sets]
    rows = [int(np.searchsorted(time_s, begin)) for begin in plan.from_s]
    while len(sets) <= MAX_SWITCHES:
        sets.append(sets[-1])
        rows.append(len(time_s) + 1)
    return tuple(sets), np.array(rows, np.int64)


def list_sets_in_force(rows: npt.NDArray[np.int64], count: int) -> list[tuple[int, slice]]:
    """Return the index of each parameter set that is in force in some of `count` rows, with those
    rows."""
    edges = np.clip(np.concatenate(([0], rows, [count])), 0, count).tolist()
    return [(k, slice(begin, end)) for k, (begin, end) in enumerate(pairwise(edges)) if begin < end]


# The start state is made anew for each run, because the run writes into it.
_STAGE: dict[str, tuple[Any, Any, Any]] = {
    "shaft": (run_shaft, make_shaft_start, ShaftOutput),
    "gate": (run_gate, make_gate_start, GateOutput),
}


def simulate_drive_rows(drive: Drive) -> RowPredictor:
    """Shaft or gate asked for what the log asked: where it truly stood and what was read, r/min
    or mm."""
    count, command = len(drive.time_s), drive.command
    first, begin_s = float(command[0]), float(drive.clock_s[0])
    run_stage, start, output = _STAGE[drive.name]
    known = drive.measured[np.isfinite(drive.measured)][:FIRST_READINGS]
    first_reading = float(np.median(known)) if len(known) else first
    if drive.name == "shaft":
        inputs = make_input_rows(
            ShaftInput,
            count,
            command_rpm=command,
            opening_mm=drive.loads_mm,
            supply_v=drive.supply_v,
            pitch_deg=drive.pitch_deg,
            more_percent=drive.more,
            more_rpm=drive.more_rpm,
        )
    else:
        inputs = make_input_rows(GateInput, count, command_mm=command, more_mm=drive.more)

    def run(plan: Schedule, step_s: float) -> Array:
        sets, rows = list_parameter_switches(plan, drive.name, drive.time_s)
        state = start(first, begin_s)
        # A slow drive does not forget where it stood within the rows that are left out.
        if drive.name == "shaft" and calc_settling_s(sets[0]) > SETTLE_S:
            state = state._replace(rpm=first_reading)
        return np.asarray(
            run_stage(
                sets,
                rows,
                state,
                output(first, first),
                inputs,
                drive.clock_s,
                step_s,
            )
        )

    return run


def calc_settling_s(p: Shaft) -> float:
    """Return the time in which a shaft forgets its speed at the start, s."""
    return START_SETTLE_TAUS * (calc_dead_time_s(p) + calc_time_constant_s(p))


def make_drive_channel(drive: Drive, machine: Machine) -> ChannelSeries:
    """What is read of shaft or gate."""
    run = simulate_drive_rows(drive)

    def predict(plan: Schedule, step_s: float) -> Array:
        return drive.grid.interpolate(run(plan, step_s)[:, 1])

    sd = machine.noise.shaft_rpm if drive.name == "shaft" else machine.noise.opening_mm
    floor = max(_estimate_rounding_sd(drive.measured), drive.step / np.sqrt(12.0), 0.02 * sd)
    prior = NoisePrior(sd, WHITE_TIME_S, floor)
    # Each row is the mean of an answer, so the noise of a row does not reach into the next.
    if drive.settled:
        prior = prior._replace(
            slow_share=NEGLIGIBLE_DRIFT,
            spread=(prior.spread[0], NEGLIGIBLE_SPREAD, NEGLIGIBLE_SPREAD, NEGLIGIBLE_SPREAD),
        )
    found = _make_channel(
        drive.name,
        "r/min" if drive.name == "shaft" else "mm",
        drive.grid,
        drive.measured,
        predict,
        prior,
    )
    return found._replace(settled=True, cut=merge_bands(found.cut)) if drive.settled else found


def make_hopper_channel(h: Hopper, machine: Machine) -> ChannelSeries:
    """Scale reading, kg."""
    count = len(h.time_s) - 1
    over_full_kg = scale_nominal(machine, HOPPER_CAPACITY) * HEADROOM_KG
    levels = _hopper_levels(h, over_full_kg)
    read_s = h.time_s[:-1] + h.read_at * np.diff(h.time_s)

    def predict(plan: Schedule, step_s: float) -> Array:
        scales, rows = list_parameter_switches(plan, "scale", h.time_s)
        seen = make_input_rows(
            ScaleInput,
            count,
            hopper_kg=levels(plan),
            time_s=read_s,
            pitch_deg=h.pitch_deg[:-1],
            more_kg=h.more_kg,
        )
        return h.grid.interpolate(
            np.concatenate(
                [run_scale(scales[k], seen[now]) for k, now in list_sets_in_force(rows, count)]
            )
        )

    noise = machine.noise
    per_bin = max(1.0, h.grid.step_s / 0.05)
    return _make_channel(
        "scale",
        "kg",
        h.grid,
        h.reading_kg,
        predict,
        NoisePrior(
            noise.scale_kg,
            noise.scale_correlation_s,
            machine.scale.resolution_kg / np.sqrt(12.0 * per_bin),
            walk_sd=h.unseen * machine.flow.grams_per_rev_mm / 60_000.0,
        ),
    )


def _hopper_levels(h: Hopper, over_full_kg: float) -> Callable[[Schedule], Array]:
    """Level of the hopper when it was read in each bin, kg (m,), as the flow leaves it.

    The flow follows the true opening: what the opening's reading is off by is taken off first.
    """
    count = len(h.time_s)
    turns = h.shaft_rpm > 0.0
    pieces = _list_predicted_pieces(h)
    refill_kg = h.refill_kg.copy()
    refill_kg[[begin for begin, _, _ in pieces]] = 0.0
    # The model adds the given mass in each of its steps.
    share = refill_kg / MIN_STEPS_PER_ROW

    def levels(plan: Schedule) -> Array:
        flow_sets, rows = list_parameter_switches(plan, "flow", h.time_s)
        gates, _ = list_parameter_switches(plan, "gate", h.time_s)
        offset = np.array([p.offset_mm for p in gates])[
            np.searchsorted(rows, np.arange(count), side="right")
        ]
        inputs = make_input_rows(
            FlowInput,
            count,
            shaft_rpm=h.shaft_rpm,
            pitch_deg=h.pitch_deg,
            refill_kg=share,
            opening_mm=np.where(turns, np.maximum(0.0, h.opening_mm - offset), h.opening_mm),
            more_percent=h.more_percent,
            more_kg_s=h.more_kg_s,
        )
        # The model's hopper is full at full_kg; a reading above that is taken down and put back
        # on afterwards.
        over_kg = max(0.0, float(np.nanmax(h.reading_kg)) - flow_sets[0].full_kg + over_full_kg)
        hopper = np.empty(count - 1)
        for begin, end, start_kg in pieces:
            first = FlowOutput(0.0, start_kg - over_kg)
            out = run_flow(
                flow_sets,
                rows - begin,
                make_flow_start(start_kg - over_kg, float(h.time_s[begin])),
                first,
                inputs[begin : end + 1],
                h.time_s[begin : end + 1],
                1e9,
            )
            read_at = h.read_at[begin:end]
            hopper[begin:end] = (1.0 - read_at) * out[:-1, 1] + read_at * out[1:, 1] + over_kg
        return hopper

    return levels


def _list_predicted_pieces(h: Hopper) -> list[tuple[int, int, float]]:
    """(first bin, last bin + 1, level at its begin in kg) of the stretches that are predicted
    in one go.

    A few refills are filled into the model. Over many, a flow error adds up until the model's
    hopper runs empty or over: it is then set to the level that was read after each, as it is
    after a long gap in which nobody knows what was metered: unless that ends while the hopper
    is filled, when a reading tells no level.
    """
    count = len(h.time_s) - 1
    fills = h.jumps if len(h.jumps) > MAX_REFILLS else ()
    level_known = set(h.grid.rows.tolist())
    gap_ends = {end for end, _ in h.gaps if end in level_known}
    begins = [0, *sorted({j for j in (*fills, *gap_ends) if 0 < j < count})]
    levels = [
        h.start_kg,
        *(_estimate_level_kg(h.reading_kg[j : j + 6], h.start_kg) for j in begins[1:]),
    ]
    return list(zip(begins, [*begins[1:], count], levels, strict=True))


def _estimate_level_kg(reading_kg: Array, unknown_kg: float) -> float:
    known = reading_kg[np.isfinite(reading_kg)]
    return float(np.median(known)) if len(known) else unknown_kg


def select_speed_rows(s: TwoSpeeds) -> RowPredictor:
    """Wheel and GNSS speed at the log's readings, m/s. The true speed runs on between them, in
    rows of SPEED_STEP_S."""
    clock = join_clock(s.time_s, SEAM_S)
    fine_s = np.arange(clock[0], clock[-1] + SPEED_STEP_S, SPEED_STEP_S)
    in_log_s = np.interp(fine_s, clock, s.time_s)
    middle = fine_s + 0.5 * SPEED_STEP_S
    inputs = make_input_rows(
        SpeedInput,
        len(fine_s),
        speed_mps=np.interp(middle, clock, s.true_mps),
        working=np.interp(middle, clock, s.working),
        pitch_deg=np.interp(middle, clock, s.pitch_deg),
        more_percent=s.more_percent
        if isinstance(s.more_percent, float)
        else np.interp(middle, clock, s.more_percent),
    )
    at = np.minimum(len(fine_s) - 1, np.round((clock - clock[0]) / SPEED_STEP_S).astype(int))
    first = float(s.true_mps[0])

    def run(plan: Schedule, step_s: float) -> Array:
        sets, rows = list_parameter_switches(plan, "speed", in_log_s)
        return np.asarray(
            run_speed(
                sets,
                rows,
                make_speed_start(first, float(fine_s[0])),
                SpeedOutput(first, first),
                inputs,
                fine_s,
                step_s,
            )[at]
        )

    return run


def make_speed_channel(s: TwoSpeeds, machine: Machine) -> ChannelSeries:
    """Build the speed channel: wheel minus GNSS speed, m/s. The difference cancels the ground
    speed."""
    run = select_speed_rows(s)

    def predict(plan: Schedule, step_s: float) -> Array:
        out = run(plan, step_s)
        return s.grid.interpolate(out[:, 0] - out[:, 1])

    sd = float(np.hypot(machine.noise.gnss_mps, machine.noise.wheel_mps))
    return _make_channel(
        "speed",
        "m/s",
        s.grid,
        s.wheel_mps - s.gnss_mps,
        predict,
        NoisePrior(sd, WHITE_TIME_S, 0.05 * sd),
    )


def make_heads_channel(h: HeadContrasts, machine: Machine) -> ChannelSeries:
    """Build the canopy channel: each head minus the mean of all heads, stacked."""
    used = np.flatnonzero(np.isfinite(h.ndvi).any(axis=1))
    measured = h.ndvi[used] - h.mean
    seen = [
        make_input_rows(HeadInput, len(h.time_s), ndvi=h.mean, head=float(head + 1), on_s=h.time_s)
        for head in used
    ]

    def predict(plan: Schedule, step_s: float) -> Array:
        sets, rows = list_parameter_switches(plan, "heads", h.time_s)
        there = list_sets_in_force(rows, len(h.time_s))
        reads = np.array(
            [np.concatenate([run_heads(sets[k], one[now]) for k, now in there]) for one in seen]
        )
        return h.grid.interpolate(reads - reads.mean(axis=0)).ravel()

    length = len(h.grid.even_s)
    bounds = tuple((k * length, (k + 1) * length) for k in range(len(used)))
    prior = NoisePrior(2.0 * machine.noise.ndvi, 3.0, 0.7 * machine.noise.ndvi)
    return ChannelSeries(
        "heads",
        "NDVI",
        h.grid.interpolate(measured).ravel(),
        predict,
        h.grid,
        make_segments(length * len(used), bounds),
        prior,
        len(used),
    )


def predict_binned_effort(e: DriveEffort) -> Callable[[Schedule], Array]:
    """Return a function that predicts the mean effort in each bin: (m,), in the machine file's
    unit, NaN for a bin that is left out."""
    ways = _EFFORT[e.name]
    inputs = make_input_rows(
        EffortInput,
        len(e.time_s),
        speed=e.speed,
        speed_per_s=e.speed_per_s,
        supply_share=e.supply_share,
    )

    def predict(plan: Schedule) -> Array:
        efforts, rows = list_parameter_switches(plan, "effort", e.time_s)
        flows, _ = list_parameter_switches(plan, "flow", e.time_s)
        gates, _ = list_parameter_switches(plan, "gate", e.time_s)
        reads = []
        for k, now in list_sets_in_force(rows, len(e.time_s)):
            seen = inputs[now].copy()
            # The gate moves no material, so only the shaft has a material load.
            if e.name == "effort":
                opening = np.maximum(0.0, e.opening_mm[now] - gates[k].offset_mm)
                seen["grams_rev"], seen["packed_g_rev"] = run_flutes(
                    flows[k],
                    e.speed[now],
                    opening,
                    e.pitch_deg[now],
                    e.share_full[now],
                    e.time_s[now],
                    e.refilled,
                ).T
            reads.append(ways(efforts[k], seen))
        return e.bin_row_means(np.concatenate(reads))

    return predict


def make_effort_channel(e: DriveEffort, machine: Machine) -> ChannelSeries:
    """Build the channel of a drive's effort, on an even grid."""
    bins = predict_binned_effort(e)

    def predict(plan: Schedule, step_s: float) -> Array:
        return e.grid.interpolate(bins(plan))

    noise = machine.noise.effort
    floor = noise / np.sqrt(max(1.0, e.rows_per_bin))
    return _make_channel(
        e.name,
        machine.effort_unit,
        e.grid,
        e.bin_row_means(e.measured),
        predict,
        NoisePrior(noise, 1.0, floor),
    )


_EFFORT = {"effort": run_shaft_effort, "gate_effort": run_gate_effort}


def make_channels(data: RunData, machine: Machine) -> dict[str, ChannelSeries]:
    """Return every channel that the log can show, by name. Flow and scale share the scale's
    reading."""
    found: dict[str, ChannelSeries] = {}
    if data.shaft is not None:
        found["shaft"] = make_drive_channel(data.shaft, machine)
    if data.gate is not None:
        found["gate"] = make_drive_channel(data.gate, machine)
    if data.hopper is not None:
        found["scale"] = make_hopper_channel(data.hopper, machine)
    if data.speed is not None:
        found["speed"] = make_speed_channel(data.speed, machine)
    for effort in data.efforts:
        found[effort.name] = make_effort_channel(effort, machine)
    if data.heads is not None:
        found["heads"] = make_heads_channel(data.heads, machine)
    return found


def _make_channel(
    name: str,
    unit: str,
    grid: Grid,
    measured: Array,
    predict: Callable[[Schedule, float], Array],
    prior: NoisePrior,
) -> ChannelSeries:
    series = grid.interpolate(measured)
    return ChannelSeries(name, unit, series, predict, grid, make_segments(len(series)), prior)


def _estimate_rounding_sd(measured: Array) -> float:
    """Return the standard deviation of rounding to the smallest step between readings."""
    known = np.unique(measured[np.isfinite(measured)][:20000])
    steps = np.diff(known)
    steps = steps[steps > 1e-9]
    return (
        float(np.percentile(steps, 5) / np.sqrt(12.0)) if len(steps) and len(known) < 2000 else 0.0
    )


def remove_narrowband(
    seen: dict[str, ChannelSeries], machine: Machine
) -> tuple[dict[str, ChannelSeries], list[str]]:
    """Remove narrowband noise from the speed channel, and return the channels with a finding for
    the user where there was any.

    The speed channel is the difference of two noisy speeds. An oscillation that is shifted in time
    against itself partly cancels, so the oscillation would be mistaken for a latency. A noise model
    of two first-order components would also spread the power of a single line over all frequencies
    near the line. No tractor oscillates this fast, so no motion is lost.
    """
    if "speed" not in seen:
        return seen, []
    channel = seen["speed"]
    periods_s = find_narrowband_periods(channel, machine)
    if not len(periods_s):
        return seen, []
    least_s = max(MAX_NOISE_PERIOD_S, PERIOD_SPREAD * float(periods_s.max()))
    quick = channel.cut.omega * least_s > 2.0 * np.pi * channel.grid.step_s
    if quick.all():
        return seen, []
    said = " and ".join(f"{period_s:.2g} s" for period_s in periods_s)
    return (
        {**seen, "speed": channel._replace(cut=noises.leave_out_bands(channel.cut, quick))},
        [
            f"speed: a sensor oscillates with a period of {said}; the speeds are compared over "
            f"periods longer than {least_s:.2g} s"
        ],
    )


def find_narrowband_periods(channel: ChannelSeries, machine: Machine) -> Array:
    """Return the periods of narrow lines in a channel that the nominal machine does not explain, s,
    longest first: (k,).

    A band's power over the power of the neighbouring bands is an F variable. Its degrees of freedom
    are the band's own coefficients and those of the estimated variance (`BAND_DOF`). All bands
    together have the significance level of the other checks.
    """
    left = channel.measured - channel.predict(
        make_schedule(list_stages(machine), ()), MAX_MODEL_STEP_S
    )
    cut, step_s = channel.cut, channel.grid.step_s
    power = np.add.reduceat(noises.calc_coefficients(left, cut) ** 2, cut.starts)
    fitted = noises.fit_noise(
        power, noises.find_starting_noise(channel.prior), channel.prior, cut, step_s
    )
    over = (
        power
        / cut.members
        / noises.calc_spectrum(np.array(fitted.theta), channel.prior, cut, step_s)
    )
    about = [
        np.r_[max(0, k - NEIGHBOUR_BANDS) : k, k + 1 : min(len(over), k + 1 + NEIGHBOUR_BANDS)]
        for k in range(len(over))
    ]
    usual = np.array([float(np.median(over[near])) if len(near) else np.inf for near in about])
    by_chance = fdtrc(cut.members, BAND_DOF, over / np.maximum(usual, 1e-300))
    stand_out = (by_chance < FALSE_ALARM_PROB / len(over)) & (
        cut.omega * MAX_NOISE_PERIOD_S > 2.0 * np.pi * step_s
    )
    return np.asarray(2.0 * np.pi / cut.omega[stand_out] * step_s)

"""Converts bench tables to pieces, a section for each kind of table: measured rows, and the machine
model's prediction.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.calibration.bench_table import LAG_COLUMNS, BenchTable, select_rows
from topdress.control.diagnosis.effects import (
    CANOPY_HEAD_FOULED,
    CANOPY_SATURATION,
    CANOPY_WARM_UP,
    FLOW_FILL_FALLOFF,
    FLOW_GAIN,
    FLOW_OUTLET_UNEVEN,
    FLOW_PULSATION,
    FLOW_ZERO_OFFSET,
    LAG_ASYMMETRY,
    LAG_FIRST_FILL,
    LAG_OFFSET,
    LAG_REBOUND,
    LAG_SPEED_SCALE,
    PLACE_LATENCY,
    PLACE_LEVER_ARM,
    SCALE_GAIN,
    SHAFT_DEAD_TIME,
    SPEED_WHEEL_RADIUS,
    SPEED_WHEEL_SLIP,
)
from topdress.control.experiments.bench_tests import predict_wheel_mps
from topdress.control.experiments.setting_levels import USUAL_SPEED_MPS
from topdress.control.machine.fall import calc_drop_s, find_start_drop_s
from topdress.control.machine.flow import Flow, calc_grams_per_rev
from topdress.control.machine.heads import WARM_UP_S, HeadInput, read_head
from topdress.control.machine.machine import Machine
from topdress.control.machine.scale import ScaleInput, read_scale
from topdress.control.machine.start_lag import calc_change_response_s, calc_response_s

from .table_series import Array, BoolArray, MeasuredSeries, TableCandidate, list_varying

# Label words for a start with an empty tube.
EMPTY_WORDS = frozenset({"empty", "standstill", "start", "first", "stopped", "zero"})
# Label words for a change of a running shaft.
RUNNING_WORDS = frozenset({"running", "change", "full", "filled", "flowing"})
# Label words for a rise of the rate.
RISE_WORDS = frozenset({"up", "rise", "rising", "increase"})
# Label words for a fall of the rate.
FALL_WORDS = frozenset({"down", "fall", "falling", "decrease"})
# Alternative shapes of a rise: start as a share of full_rpm, and power.
RISE_SHAPES = ((0.6, 1.0), (0.7, 0.5), (0.7, 2.0), (0.75, 1.0), (0.8, 1.0))
UNCORRECTED_LABEL = "before"
# Share of the median mass below which even proportional noise is constant.
PROPORTIONAL_NOISE_MASS_SHARE = 0.1
# Minimum number of speeds (of a fall-off) or times (of warming up) beyond the free shapes:
# otherwise the shapes fit exactly.
MIN_LEVELS_BEYOND_SHAPES = 3
# Number of flute passages in the shortest catch above which no catch shows a pulsation.
MAX_FLUTE_PASSAGES = 3.0
WEIGHED_EFFECTS = (FLOW_GAIN, FLOW_ZERO_OFFSET, SPEED_WHEEL_SLIP, SPEED_WHEEL_RADIUS, SCALE_GAIN)
# Assumed time since switch-on, s, where the table does not say: the heads are warm.
WARM_S = 100.0 * WARM_UP_S
# NDVI of a dense canopy at which the catalogue defines the loss of a head.
DENSE_NDVI = 0.8
# Trial warm-up rates besides the model's, as shares of the model's rate.
WARM_UP_RATES = (0.5, 2.0, 0.25)


# Labels: rows that belong together, and the state before a change of the rate.


class RowRoles(NamedTuple):
    """Roles of rows. `start`: (n,) 1 for an empty tube. `change`: (n,) +1 after a rise, -1 after a
    fall, 0 for unknown.

    `running`: (n,) rows that state the speed of a shaft that turned before the change.
    """

    start: Array
    change: Array
    running: BoolArray
    tell_start: bool
    tell_direction: bool

    @property
    def known(self) -> bool:
        return self.tell_start or self.tell_direction


def list_labels(table: BenchTable) -> npt.NDArray[np.str_]:
    """Return the label of each row, (n,); "" where the table has none."""
    return np.full(table.rows, "") if table.label is None else table.label


def find_label_column(table: BenchTable) -> str:
    """Return the column of the labels, as a sentence names it."""
    return table.label_column or "label"


def read_roles(table: BenchTable) -> RowRoles:
    """Read labels and previous speeds; start and direction are known only where both of their cases
    occur."""
    label, running = list_labels(table), table.find_running_rows()
    words = np.array([str(text).strip().lower() for text in label], dtype=object)
    empty, running_said = np.isin(words, list(EMPTY_WORDS)), np.isin(words, list(RUNNING_WORDS))
    up, down = np.isin(words, list(RISE_WORDS)), np.isin(words, list(FALL_WORDS))
    if running.any():
        before, after = table.columns["before_rpm"], table.columns["shaft_rpm"]
        empty, up, down = ~running, running & (after > before), running & (after < before)
        starts = bool(empty.any())
        directions = bool(up.any() and down.any())
    else:
        starts = bool(empty.any() and running_said.any() and (empty | running_said).all())
        directions = bool(up.any() and down.any() and (up | down).all())
    return RowRoles(
        np.where(starts & empty, 1.0, 0.0),
        np.where(directions, up * 1.0 - down * 1.0, 0.0),
        running,
        starts,
        directions,
    )


# Lags: response, drop time, both, or the distance at the recorded speed (lag paper eq 1, 6).


def make_lag_pieces(table: BenchTable, machine: Machine) -> tuple[MeasuredSeries, ...]:
    """Return a piece for each measured column."""
    return tuple(
        _make_lag_piece(table, machine, name)
        for name in LAG_COLUMNS
        if name in table.columns and np.isfinite(table.columns[name]).sum() > 0
    )


def _make_lag_piece(table: BenchTable, machine: Machine, name: str) -> MeasuredSeries:
    keep = np.isfinite(table.columns[name])
    rpm = table.columns["shaft_rpm"][keep]
    speed = table.find_speed_mps()
    speed = None if speed is None else speed[keep]
    observed = table.columns[name][keep]
    if name == "lag_m":
        assert speed is not None
        observed = observed / speed
    label = list_labels(table)[keep]
    roles = read_roles(select_rows(table, keep))
    # A column of times besides a column of distances comes from the detector; any other may have
    # been calculated from distances.
    by_distance = name == "lag_m" or (name == "lag_s" and "lag_m" not in table.columns)

    def predict(m: Machine) -> Array:
        scale = 1.0 + m.fall.speed_scale_percent / 100.0 if by_distance else 1.0
        return predict_lag_s(m, rpm, name, roles) * scale

    drops = name != "response_s"
    nuisances = (
        {} if name == "drop_s" else {"dead_time": np.full(len(rpm), machine.tolerance.dead_time_s)}
    )
    # The shape is centred on the line, so that it is uncorrelated with the level, which is
    # `lag.offset`.
    if drops:
        nuisances["drop_slope"] = machine.tolerance.drop_s_per_rpm * (
            rpm - 0.5 * machine.fall.full_rpm
        )
    variables = {
        "shaft_rpm": rpm,
        "replicate": table.columns.get("replicate", np.full(len(keep), np.nan))[keep],
    }
    if roles.running.any():
        variables["before_rpm"] = np.nan_to_num(table.columns["before_rpm"][keep])
    if speed is not None:
        variables["speed_mps"] = speed
    # A distance has a constant error in m, so a slow drive has a large error of the time.
    spread = (
        np.ones(len(rpm)) if name != "lag_m" or speed is None else float(np.median(speed)) / speed
    )
    return MeasuredSeries(
        f"{table.path} {name}".strip(),
        "lag" if drops else "shaft",
        "s",
        observed,
        predict,
        (spread,),
        label,
        find_label_column(table),
        tuple(TableCandidate(i) for i in _list_lag_effects(name, roles)),
        _list_scoped_effects(name, roles),
        list_varying(variables),
        nuisances,
        {LAG_REBOUND.id: list_rise_shapes(rpm, machine.fall.full_rpm)} if drops else {},
        {
            LAG_REBOUND.id: list_rise_shapes(
                np.full(1, machine.fall.full_rpm), machine.fall.full_rpm
            )[0]
        },
        clocked=name != "lag_m",
        on_ground=name == "lag_m",
        named_only=frozenset() if name == "lag_m" else frozenset({LAG_SPEED_SCALE.id}),
    )


def _list_lag_effects(name: str, roles: RowRoles) -> tuple[str, ...]:
    """Return the effects that a column of lags can show."""
    drops = (LAG_OFFSET, LAG_REBOUND) if name != "response_s" else ()
    response = (SHAFT_DEAD_TIME,) if name != "drop_s" else ()
    by_label = (
        *((LAG_FIRST_FILL,) if roles.tell_start else ()),
        *((LAG_ASYMMETRY,) if roles.tell_direction else ()),
    )
    distance = (LAG_SPEED_SCALE,) if name == "lag_m" else ()
    return tuple(row.id for row in (*drops, *response, *(by_label if drops else ()), *distance))


def _list_scoped_effects(name: str, roles: RowRoles) -> tuple[str, ...]:
    """Return the effects that may hold for one label only; empty where the labels give the start of
    a change.

    Times of one label may have been calculated from distances whose recorded speed is wrong.
    """
    if roles.known:
        return ()
    ids = [*_list_lag_effects(name, roles), *([LAG_SPEED_SCALE.id] if name == "lag_s" else [])]
    return tuple(i for i in ids if i in (SHAFT_DEAD_TIME.id, LAG_OFFSET.id, LAG_SPEED_SCALE.id))


def predict_lag_s(machine: Machine, rpm: Array, name: str, roles: RowRoles) -> Array:
    """Return the lag of each row, s: the machine's model with its effects, without the scale of
    distances.

    A row is a start of a standing shaft, as a rig and the papers time it, unless the row states the
    speed before the change. A turning shaft answers as soon as its command changes and has the
    settled drop of a running shaft. Labels alone do not state the speed before; the difference
    between labels is then the result.
    """
    fall = machine.fall
    total = np.zeros(len(rpm))
    rows = list(zip(rpm.tolist(), roles.running.tolist(), strict=True))
    if name != "drop_s":
        total += [
            calc_change_response_s(machine) if running else calc_response_s(machine, n)
            for n, running in rows
        ]
    if name != "response_s":
        total += [
            calc_drop_s(fall, n) if running else find_start_drop_s(fall, n) for n, running in rows
        ]
        total += fall.first_fill_s * roles.start - 0.5 * fall.asymmetry_s * roles.change
    return total


def list_rise_shapes(rpm: Array, full_rpm: float) -> Array:
    """Return alternative shapes of a rise at high shaft speed, (n, k)."""
    return np.column_stack(
        [np.maximum(0.0, rpm - start * full_rpm) ** power for start, power in RISE_SHAPES]
    )


# Places: landing minus target position along the travel (lag paper, tables 5 and 6).


def make_place_pieces(table: BenchTable, machine: Machine) -> tuple[MeasuredSeries, ...]:
    """Return one piece: miss_m = v_true (lag + latency) - v_written x corrected lag + lever arm.

    A correction is a distance that control calculated from its lag and the speed that it assumed,
    the recorded speed (lag paper eq 1). If the true speed is higher, the lag distance grows and the
    correction does not.

    The misses alone do not propose a wrong test speed (lag.speed_scale), because latency and lever
    arm explain the same with less. Where a lag table with distances proposes a wrong test speed,
    the misses count as evidence.

    The corrected lag is the table's own `corrected_lag_s`, else 0 for rows labelled `before`, else
    the lag of the machine file in use.
    """
    rpm, speed = table.columns["shaft_rpm"], table.find_speed_mps()
    assert speed is not None
    label = list_labels(table)
    roles = read_roles(table)
    corrected = np.where(
        label == UNCORRECTED_LABEL, 0.0, predict_lag_s(machine, rpm, "lag_s", roles)
    )
    if "corrected_lag_s" in table.columns:
        given = table.columns["corrected_lag_s"]
        corrected = np.where(np.isfinite(given), given, corrected)

    def predict(m: Machine) -> Array:
        true_mps = speed * (1.0 + m.fall.speed_scale_percent / 100.0)
        lag = predict_lag_s(m, rpm, "lag_s", roles)
        return true_mps * (lag + m.fall.latency_s) - speed * corrected + m.fall.lever_arm_m

    by_label = (
        *((LAG_FIRST_FILL,) if roles.tell_start else ()),
        *((LAG_ASYMMETRY,) if roles.tell_direction else ()),
    )
    effects = (PLACE_LEVER_ARM, PLACE_LATENCY, LAG_REBOUND, *by_label)
    variables = {
        "shaft_rpm": rpm,
        "speed_mps": speed,
        "corrected_lag_s": table.columns.get("corrected_lag_s", np.full(table.rows, np.nan)),
        "replicate": table.columns.get("replicate", np.full(table.rows, np.nan)),
    }
    if roles.running.any():
        variables["before_rpm"] = np.nan_to_num(table.columns["before_rpm"])
    return (
        MeasuredSeries(
            f"{table.path} miss_m".strip(),
            "place",
            "m",
            table.columns["miss_m"],
            predict,
            (np.ones(len(rpm)),),
            label,
            find_label_column(table),
            tuple(TableCandidate(row.id) for row in effects),
            (PLACE_LEVER_ARM.id, PLACE_LATENCY.id),
            list_varying(variables),
            {"dead_time": speed * machine.tolerance.dead_time_s},
            {LAG_REBOUND.id: list_rise_shapes(rpm, machine.fall.full_rpm) * speed[:, None]},
            {
                LAG_REBOUND.id: list_rise_shapes(
                    np.full(1, machine.fall.full_rpm), machine.fall.full_rpm
                )[0]
            },
            on_ground=True,
        ),
    )


# Catches: mass from a turning shaft in a given time, all outlets together or each by itself.


def make_catch_pieces(table: BenchTable, machine: Machine) -> tuple[MeasuredSeries, ...]:
    """Return one piece: mass_kg. The replicates decide whether its noise is constant, proportional
    to the mass, or between."""
    columns = table.columns
    rpm, opening, lasts_s = columns["shaft_rpm"], columns["opening_mm"], columns["duration_s"]
    outlet = columns.get("outlet")

    def steady(m: Machine) -> Array:
        return _calc_catch_mass(m.flow, rpm, opening, lasts_s, outlet, m.geometry.outlets)

    nominal = steady(machine)
    angle = 2.0 * pi * machine.flow.flutes * rpm / 60.0 * lasts_s
    begins = _fit_pulse_phase(columns["mass_kg"], nominal, angle)

    def predict(m: Machine) -> Array:
        return steady(m) + nominal * m.flow.pulsation_percent / 100.0 * _calc_mean_pulse(
            angle, begins
        )

    share = np.maximum(nominal, 1e-9) / (float(np.median(nominal)) or 1.0)
    spreads = (
        np.ones(table.rows),
        np.hypot(share, 1.0) / np.sqrt(2.0),
        np.hypot(share, PROPORTIONAL_NOISE_MASS_SHARE),
    )
    wide = machine.model_copy(
        update={
            "flow": machine.flow._replace(
                zero_offset_g_rev=machine.flow.zero_offset_g_rev
                + machine.flow.grams_per_rev_mm * machine.tolerance.opening_mm
            )
        }
    )
    variables = {
        "shaft_rpm": rpm,
        "opening_mm": opening,
        "duration_s": lasts_s,
        "replicate": columns.get("replicate", np.full(table.rows, np.nan)),
    }
    if outlet is not None:
        variables["outlet"] = outlet
    candidates = _list_catch_candidates(
        outlet,
        pulsates=bool(
            angle.min() / (2.0 * pi) < MAX_FLUTE_PASSAGES and len(np.unique(lasts_s)) > 2
        ),
    )
    return (
        MeasuredSeries(
            f"{table.path} mass_kg".strip(),
            "flow",
            "kg",
            columns["mass_kg"],
            predict,
            spreads,
            list_labels(table),
            find_label_column(table),
            candidates,
            (FLOW_GAIN.id,),
            list_varying(variables),
            {
                "flow": nominal * machine.tolerance.flow_percent / 100.0,
                "opening_mm": predict(wide) - nominal,
                **_list_outlet_tolerances(nominal, outlet, machine),
            },
            {
                FLOW_FILL_FALLOFF.id: _list_falloff_shapes(
                    nominal, rpm, rpm, machine.flow.full_rpm
                ),
                # The alternative shape has a second harmonic too.
                FLOW_PULSATION.id: np.column_stack(
                    [nominal * _calc_mean_pulse(2.0 * angle, begins) for begins in (0.0, pi / 2.0)]
                ),
            },
            {
                FLOW_FILL_FALLOFF.id: -100.0
                * _list_falloff_shapes(
                    np.ones(1), np.full(1, machine.flow.full_rpm), rpm, machine.flow.full_rpm
                )[0]
            },
        ),
    )


def _list_catch_candidates(outlet: Array | None, pulsates: bool) -> tuple[TableCandidate, ...]:
    outlets = [] if outlet is None else [int(k) for k in np.unique(outlet) if k == int(k)]
    return (
        *(TableCandidate(row.id) for row in (FLOW_GAIN, FLOW_ZERO_OFFSET, FLOW_FILL_FALLOFF)),
        *(TableCandidate(FLOW_OUTLET_UNEVEN.id, k) for k in outlets),
        *((TableCandidate(FLOW_PULSATION.id),) if pulsates else ()),
    )


def _calc_catch_mass(
    flow: Flow, rpm: Array, opening: Array, lasts_s: Array, outlet: Array | None, outlets: int
) -> Array:
    grams = [
        calc_grams_per_rev(flow, n, o) for n, o in zip(rpm.tolist(), opening.tolist(), strict=True)
    ]
    mass = np.array(grams) * rpm / 60.0 * lasts_s / 1000.0
    if outlet is None:
        return mass * (
            1.0 + (flow.uneven_percent / outlets / 100.0 if flow.uneven_outlet > 0.0 else 0.0)
        )
    return (
        mass
        / outlets
        * (1.0 + np.where(outlet == flow.uneven_outlet, flow.uneven_percent / 100.0, 0.0))
    )


def _list_outlet_tolerances(
    nominal: Array, outlet: Array | None, machine: Machine
) -> dict[str, Array]:
    """Return the tolerances of single outlets, such that their sum stays within its tolerance."""
    if outlet is None:
        return {}
    share = machine.tolerance.flow_percent / 100.0 * float(np.sqrt(machine.geometry.outlets))
    return {
        f"outlet_{k:g}": np.where(outlet == k, nominal * share, 0.0)
        for k in np.unique(outlet).tolist()
    }


def _list_falloff_shapes(nominal: Array, rpm: Array, tested_rpm: Array, full_rpm: float) -> Array:
    """Return alternative shapes of a loss at high shaft speed, (n, k); fewer where fewer speeds
    were tested."""
    fast = rpm / full_rpm
    shapes = [fast**2, fast**5, np.maximum(0.0, fast - 0.6), fast, np.maximum(0.0, fast - 0.4)]
    return np.column_stack(
        [
            nominal * shape
            for shape in shapes[: max(1, len(np.unique(tested_rpm)) - MIN_LEVELS_BEYOND_SHAPES)]
        ]
    )


def _calc_mean_pulse(angle: Array, begins: float) -> Array:
    """Return the mean of the model's sine (flow_step) over a catch of this angle of flutes,
    radians, that starts at `begins`, (n,)."""
    angle = np.maximum(angle, 1e-9)
    return np.asarray((np.cos(begins) - np.cos(begins + angle)) / angle)


def _fit_pulse_phase(mass: Array, nominal: Array, angle: Array) -> float:
    """Return the best-fitting phase at which the catches begin within a flute's passage, radians,
    for an otherwise constant flow."""
    known = nominal > 0.0
    columns = [
        np.ones(int(known.sum())),
        _calc_mean_pulse(angle, 0.0)[known],
        _calc_mean_pulse(angle, pi / 2.0)[known],
    ]
    fit, *_ = np.linalg.lstsq(
        np.column_stack(columns) * nominal[known, None], mass[known], rcond=None
    )
    return float(np.arctan2(fit[2], fit[1]))


# Plots: target and applied mass (decision paper, table 2).


def make_weigh_pieces(table: BenchTable, machine: Machine) -> tuple[MeasuredSeries, ...]:
    """Return one piece: applied_kg. The model gives the metering, the wheel the speed, the hopper
    scale the applied mass."""
    columns = table.columns
    target = columns["target_kg"]
    speed = table.find_speed_mps()
    mean_mps = USUAL_SPEED_MPS if speed is None else float(np.nanmean(speed))
    rpm = machine.set_points.shaft_rpm
    turns = _count_shaft_turns(table, machine, mean_mps)
    opening = target * 1000.0 / np.maximum(turns * calc_grams_per_rev(machine.flow, rpm, 1.0), 1e-9)

    def predict(m: Machine) -> Array:
        moved = predict_wheel_mps(m, mean_mps) / predict_wheel_mps(machine, mean_mps)
        grams = np.array(
            [
                calc_grams_per_rev(m.flow, rpm, o)
                / max(calc_grams_per_rev(machine.flow, rpm, o), 1e-9)
                for o in opening.tolist()
            ]
        )
        weighed = read_scale(m.scale, ScaleInput(100.0, 0.0)) / read_scale(
            machine.scale, ScaleInput(100.0, 0.0)
        )
        return np.asarray(target * grams * moved * weighed, np.float64)

    # The mass is the difference of two readings of the scale; the rounding of a digit is uniform.
    noise = float(
        np.hypot(machine.noise.scale_kg, machine.scale.resolution_kg / np.sqrt(12.0)) * np.sqrt(2.0)
    )
    variables = {
        "target_kg": target,
        "area_m2": columns["area_m2"],
        "replicate": columns.get("replicate", np.full(table.rows, np.nan)),
    }
    if speed is not None:
        variables["speed_mps"] = speed
    return (
        MeasuredSeries(
            f"{table.path} applied_kg".strip(),
            "flow",
            "kg",
            columns["applied_kg"],
            predict,
            (np.ones(table.rows),),
            list_labels(table),
            find_label_column(table),
            tuple(TableCandidate(row.id) for row in WEIGHED_EFFECTS),
            (),
            list_varying(variables),
            {
                "flow": target * machine.tolerance.flow_percent / 100.0,
                "wheel": target * machine.tolerance.wheel_percent / 100.0,
            },
            {FLOW_ZERO_OFFSET.id: target[:, None], FLOW_GAIN.id: np.ones((table.rows, 1))},
            noise_sd=noise,
        ),
    )


def _count_shaft_turns(table: BenchTable, machine: Machine, mean_mps: float) -> Array:
    """Return the number of revolutions of the shaft on each plot, (n,).

    Where the table has no revolutions, they follow from the strategy: at the set-point's shaft
    speed they are proportional to the area (opening first), at a fixed opening to the target (speed
    first). The strategy is chosen by the better fit of an offset at zero opening, which is a
    constant mass per revolution.
    """
    columns = table.columns
    if "revolutions" in columns:
        return columns["revolutions"]
    target = columns["target_kg"]
    width = columns.get("width_m", np.full(table.rows, machine.geometry.working_width_m))
    by_area = columns["area_m2"] / (width * mean_mps) * machine.set_points.shaft_rpm / 60.0
    by_target = by_area * target / float(np.mean(target))
    error_kg = columns["applied_kg"] - target

    def rss(turns: Array) -> float:
        return float(np.sum((error_kg - turns * np.sum(turns * error_kg) / np.sum(turns**2)) ** 2))

    return by_target if rss(by_target) < rss(by_area) else by_area


# Heads: reading of each canopy head over references of known NDVI.


def make_heads_pieces(table: BenchTable, machine: Machine) -> tuple[MeasuredSeries, ...]:
    """Return one piece: ndvi. Warm-up can show only where the table states how long the heads had
    been on."""
    columns = table.columns
    reference, head = columns["ndvi_reference"], columns["head"]
    timed = "warm_min" in columns
    on_s = columns["warm_min"] * 60.0 if timed else np.full(table.rows, WARM_S)
    on_s = np.where(np.isfinite(on_s), on_s, WARM_S)
    inputs = [
        HeadInput(*row)
        for row in zip(reference.tolist(), head.tolist(), on_s.tolist(), strict=True)
    ]

    def predict(m: Machine) -> Array:
        return np.array([read_head(m.heads, one) for one in inputs])

    candidates = [
        TableCandidate(CANOPY_HEAD_FOULED.id, int(k)) for k in np.unique(head) if k == int(k)
    ]
    candidates += [
        TableCandidate(CANOPY_SATURATION.id),
        *([TableCandidate(CANOPY_WARM_UP.id)] if timed else []),
    ]
    rates = WARM_UP_RATES[: max(1, len(np.unique(on_s)) - MIN_LEVELS_BEYOND_SHAPES)]
    forms = {
        CANOPY_SATURATION.id: _list_flattening_shapes(reference),
        CANOPY_WARM_UP.id: np.column_stack(
            [reference * np.exp(-on_s / (k * WARM_UP_S)) for k in rates]
        ),
    }
    tolerance = machine.tolerance.head_percent / 100.0
    variables = {
        "ndvi_reference": reference,
        "head": head,
        "replicate": columns.get("replicate", head * np.nan),
    }
    if timed:
        variables["warm_min"] = on_s / 60.0
    if "height_m" in columns:
        variables["height_m"] = columns["height_m"]
    return (
        MeasuredSeries(
            f"{table.path} ndvi".strip(),
            "heads",
            "NDVI",
            columns["ndvi"],
            predict,
            (np.ones(table.rows),),
            list_labels(table),
            find_label_column(table),
            tuple(candidates),
            (),
            list_varying(variables),
            {
                f"head_{int(k)}": np.where(head == k, reference * tolerance, 0.0)
                for k in np.unique(head)
            },
            forms,
            {
                CANOPY_WARM_UP.id: np.full(len(rates), 100.0),
                CANOPY_SATURATION.id: -100.0
                / DENSE_NDVI
                * _list_flattening_shapes(np.full(1, DENSE_NDVI))[0],
            },
            noise_sd=machine.noise.ndvi,
        ),
    )


def _list_flattening_shapes(reference: Array) -> Array:
    """Return alternative shapes of the loss of a reading in a dense canopy, (n, k)."""
    return np.column_stack(
        [reference**2, reference**3, reference**6, np.maximum(0.0, reference - 0.6)]
    )


_PIECE_MAKERS: dict[str, Callable[[BenchTable, Machine], tuple[MeasuredSeries, ...]]] = {
    "lag": make_lag_pieces,
    "catch": make_catch_pieces,
    "weigh": make_weigh_pieces,
    "heads": make_heads_pieces,
    "place": make_place_pieces,
}


def make_table_pieces(table: BenchTable, machine: Machine) -> tuple[MeasuredSeries, ...]:
    """Return a piece for each measured column of a usable table
    (control.calibration.bench_table.usable)."""
    return _PIECE_MAKERS[table.kind](table, machine)

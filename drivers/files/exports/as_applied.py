"""Which rate was applied at which place? A run log is divided into segments of worked ground, each
with area, target and mass, and their sums.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import prepare_rule
from topdress.control.field.coverage import Coverage, CoveredArea
from topdress.control.field.job_totals import MaterialArrival, Totaliser, Totals
from topdress.control.field.width_error import WidthError, measure_width_error
from topdress.control.geodesy import Place, TangentPlane
from topdress.control.log_row import HEAD_COLUMNS
from topdress.control.loop.effort_watch import make_effort_input
from topdress.control.machine.effort import calc_shaft_effort
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.landing import calc_fall_times_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.sections import LoggedValves, SectionStrip
from topdress.control.metering.inverse_model import Conditions
from topdress.control.orders import State, TargetSource
from topdress.drivers.files.exports.released_while_stopped import (
    MIN_TURNING_SHAFT_RPM,
    ReleaseWhileStopped,
    find_stopped_releases,
    find_stopped_rows,
)
from topdress.drivers.files.read_log import RunLog
from topdress.drivers.plain_text import OneLineError

Floats = npt.NDArray[np.float64]

# Longest step between rows, s; no material is counted in a longer gap.
MAX_ROW_STEP_S = 1.0
# Number of mean steps that make a gap, in a log with fewer rows than one a second.
MAX_GAP_FREE_MEAN_STEPS = 2.5
# Length of a segment, s, which gives about a record a second.
DEFAULT_STRETCH_S = 1.0
# Relative difference up to which widths agree: they are reported rounded, and as driven.
SAME_WIDTH_TOLERANCE = 0.02
# Size of a cell in the raster of covered ground, m.
COVERAGE_CELL_M = 0.2
# Distance between two entries into that raster, m.
COVER_STEP_M = 0.5
# Columns without which a log cannot be exported.
NEEDED_COLUMNS = ("lat_deg", "lon_deg", "applied_rate_kg_ha")
# Columns of speed; the first one that a log has is its speed.
SPEED_COLUMNS = ("speed_used_mps", "speed_mps", "wheel_speed_mps")


class ExportError(OneLineError):
    """Reports a log that cannot be exported; the line names file, column and the permitted
    values."""


class SpreadProduct(NamedTuple):
    """Names the product and its share of nitrogen."""

    name: str
    # Share of nitrogen in the product, 0 to 1.
    n_fraction: float


class WorkedStretches(NamedTuple):
    """Holds segments (n,) of worked ground in the order of work; positions are those where the
    material landed."""

    # Time of release in the middle of the segment, s.
    time_s: Floats
    lat_deg: Floats
    lon_deg: Floats
    # Corners (n, 4, 2) in latitude and longitude: left and right at the begin, right and left at
    # the end.
    corners_deg: Floats
    heading_deg: Floats
    speed_mps: Floats
    duration_s: Floats
    # Speed x duration.
    length_m: Floats
    # Length x width.
    area_m2: Floats
    # NaN for an unknown target.
    target_kg_ha: Floats
    applied_kg_ha: Floats
    # 0 for an unknown target.
    target_kg: Floats
    applied_kg: Floats
    shaft_rpm: Floats
    opening_mm: Floats
    fix_quality: Floats
    satellites: Floats
    hdop: Floats
    # Effort of the metering drive above the effort of the machine file, %; NaN where unknown.
    effort_percent: Floats
    # Width of the whole machine, or of one section of a machine with section valves.
    width_m: Floats


class CropLimitedGround(NamedTuple):
    """Holds the ground on which the target exceeded the crop's limit, so that the limit was
    applied."""

    limit_kg_ha: float
    area_ha: float
    # The highest target on this ground.
    highest_kg_ha: float
    # Mass by which the limit reduced the target.
    less_kg: float


@dataclass(frozen=True, eq=False)
class AsApplied:
    """Holds a job as it was done. Sums of the segments equal the log's own sums to rounding, except
    for the mass released at standstill, which belongs to no segment."""

    title: str
    machine: Machine
    product: SpreadProduct
    stretches: WorkedStretches
    totals: Totals
    # UTC at time_s = 0.
    begin_utc: dt.datetime | None
    # The field's outline (k, 2), latitude and longitude.
    field_deg: Floats | None
    # None if the limit never applied, or is unknown.
    cut: CropLimitedGround | None
    # Cost of a single rate across the width; None for a rate without canopy sensing, or where it
    # cannot be computed.
    one_rate: WidthError | None = None
    # Worked ground by its position: with applied material, and with a rate of 0.
    ground: CoveredArea | None = None
    # Material released while the machine was commanded to stop; totals.stopped_kg includes it.
    stopped: tuple[ReleaseWhileStopped, ...] = ()

    @property
    def worked_ha(self) -> float:
        """Worked ground, ha, with each pass counted; from positions, or from speed and time without
        positions."""
        # Overlap counts as worked, because material was applied twice.
        ground = self.ground
        return self.totals.area_ha if ground is None else ground.area_ha + ground.overlap_ha

    @property
    def mean_kg_ha(self) -> float:
        """Mean rate, kg/ha: all mass applied in work, divided by the worked ground."""
        # Material released at standstill belongs to no worked area.
        return (
            (self.totals.applied_kg - self.totals.stopped_kg) / self.worked_ha
            if self.worked_ha > 0.0
            else 0.0
        )

    @property
    def width_m(self) -> float:
        """The machine's working width, m."""
        return self.machine.geometry.working_width_m

    def utc(self, time_s: float) -> dt.datetime | None:
        """Returns the UTC of a time of the log, s; None where the log has no UTC."""
        return None if self.begin_utc is None else self.begin_utc + dt.timedelta(seconds=time_s)


def build_as_applied(
    log: RunLog,
    machine: Machine | None = None,
    product: SpreadProduct | None = None,
    every_s: float = DEFAULT_STRETCH_S,
) -> AsApplied:
    """Returns the applied work of a log's machine, in segments of at most `every_s`.

    Rows of work are counted, and rows in which the shaft turned though commanded to stop. The
    applied rate is the log's, times the scale's correction of the flow model where the log has one.
    A segment is where its material landed: behind the antenna by the machine's geometry, and
    further along the path by the drop time.

    Parameters
    ----------
    log : the run log.
    machine : replaces a machine that the log's sidecar does not name.
    product : replaces a product that the log's sidecar does not name.
    every_s : longest segment, s.

    Returns
    -------
    segments, sums and further results.

    Raises
    ------
    ExportError : a column, the machine or any worked row is missing.
    """
    machine = machine or _read_machine(log)
    # All needed columns are tested first, because the computation takes seconds.
    for column in NEEDED_COLUMNS:
        if not log.has(column):
            raise ExportError(f"{log.path}: column {column}: empty: allowed is a log that has it")
    if _find_speed_column(log) is None:
        raise ExportError(
            f"{log.path}: column {SPEED_COLUMNS[0]}: empty: allowed is a log that has it"
        )
    # The condition is written so that NaN is refused too.
    if not every_s > 0.0:
        raise ExportError(f"{log.path}: every {every_s:g} s: allowed is above 0")
    rows = _select_worked_rows(log, machine)
    if not len(rows.time_s):
        raise ExportError(f"{log.path}: no row of work with a place: allowed is a log with some")
    _check_machine_width(log, machine)
    product = product or _read_product(log)
    strips = find_section_strips(log, machine)
    width_m = machine.geometry.working_width_m
    # Ground with material and ground with a rate of 0 are reported separately.
    covered = _cover_ground(
        rows, width_m, strips, rows.opened & (rows.applied_kg_ha > 0.0)[:, None]
    )
    ground = _cover_ground(rows, width_m, strips, rows.opened)
    doses, missed = _count_doses(log)
    totals = _sum_log_rows(log, machine, product)._replace(
        covered_ha=covered.area_ha, overlap_ha=covered.overlap_ha, doses=doses, doses_missed=missed
    )
    return AsApplied(
        log.path.stem,
        machine,
        product,
        _gather_stretches(rows, strips, every_s),
        totals,
        _find_begin_utc(log),
        _read_outline_deg(log),
        _find_limited_ground(log, rows, strips),
        _calc_one_rate_cost(log, machine),
        ground,
        find_stopped_releases(log),
    )


class _WorkedRows(NamedTuple):
    """Holds worked rows (n,), and the position on a plane where each row's material landed at the
    begin and end of its step."""

    plane: TangentPlane
    time_s: Floats
    step_s: Floats
    speed_mps: Floats
    applied_kg_ha: Floats
    target_kg_ha: Floats
    # Array (n, 2).
    begin_m: Floats
    end_m: Floats
    heading_deg: Floats
    shaft_rpm: Floats
    opening_mm: Floats
    fix_quality: Floats
    satellites: Floats
    hdop: Floats
    effort_percent: Floats
    # Array (n, sections) of the sections that flowed; one column for a machine without sections.
    opened: npt.NDArray[np.bool_]


def _select_worked_rows(log: RunLog, machine: Machine) -> _WorkedRows:
    """Returns the counted rows with the positions of their material."""
    time = log.time_s
    step = np.diff(time, prepend=time[:1])
    applied, speed = calc_applied_rate_kg_ha(log), _read_speed_mps(log)
    # Rows before the first arrival of material are excluded, as in the totals.
    counts = (
        (find_arrived_rows(log) | find_stopped_rows(log))
        & (step > 0.0)
        & (step <= _find_max_step_s(log))
    )
    counts &= np.isfinite(applied) & np.isfinite(speed) & (speed > 0.0)
    shaft = log.numbers("shaft_rpm")
    # Each row's material falls for its own time, by its shaft speed.
    drop = calc_fall_times_s(
        time,
        np.array([calc_drop_s(machine.fall, n) for n in np.nan_to_num(shaft).tolist()]),
        machine.fall.carried_share,
    )
    plane, way_m, heading = find_outlet_way(log, machine)
    # A row's material lands later than it leaves, by its drop time.
    lands = time + drop
    # A segment reaches from the landing of the previous row to that of this row.
    begin, end = _find_places_at(lands - step, time, way_m), _find_places_at(lands, time, way_m)
    # Headings are interpolated unwrapped, because the middle of 359 and 1 deg is 0.
    turned = np.degrees(np.unwrap(np.radians(heading)))
    at = np.interp(lands - 0.5 * step, time, turned) % 360.0
    # A machine that is commanded to stop has no target.
    wanted = np.where(find_worked_rows(log), log.numbers("target_rate_kg_ha"), np.nan)
    columns = [
        time,
        step,
        speed,
        applied,
        wanted,
        begin,
        end,
        at,
        shaft,
        log.numbers("opening_mm"),
        log.numbers("fix_quality"),
        log.numbers("satellites"),
        log.numbers("hdop"),
        calc_effort_percent(log, machine),
    ]
    return _WorkedRows._make(
        (plane, *(column[counts] for column in (*columns, find_open_strips(log, machine))))
    )


def calc_effort_percent(log: RunLog, machine: Machine) -> Floats:
    """Returns the difference of the metering drive's effort to the effort of its machine file.

    Speed, opening, supply, pitch and fill are taken from the log, else as nominal.

    Returns
    -------
    (n,) percent for each row; NaN where no effort is known, or where the model expects less than
    its noise.
    """
    effort, rpm, opening = (
        np.abs(log.numbers(name)) for name in ("shaft_effort", "shaft_rpm", "opening_mm")
    )
    # A standing shaft has no effort to compare.
    known = np.isfinite(effort) & np.isfinite(opening) & (rpm > MIN_TURNING_SHAFT_RPM)
    if not machine.has_stage("effort") or not known.any():
        return np.full(len(log), np.nan)
    pitch, kg, supply = (
        # Missing conditions are replaced by nominal values, which change the effort little.
        np.where(np.isfinite(values := log.numbers(name)), values, usual)
        for name, usual in (
            ("pitch_deg", 0.0),
            ("hopper_kg", machine.flow.full_kg),
            ("supply_v", machine.shaft.nominal_supply_v),
        )
    )
    should = np.full(len(log), np.nan)
    should[known] = [
        calc_shaft_effort(
            machine.effort,
            make_effort_input(machine, turns, mm, Conditions(at_s, full_kg, deg, volts)),
        )
        for turns, mm, at_s, full_kg, deg, volts in np.column_stack(
            (rpm, opening, log.time_s, kg, pitch, supply)
        )[known].tolist()
    ]
    # The ratio to an expected effort within the noise is meaningless.
    return np.where(should > machine.noise.effort, 100.0 * (effort / should - 1.0), np.nan)


def find_section_strips(log: RunLog, machine: Machine) -> tuple[SectionStrip, ...]:
    """Returns the strips of the sections whose valves the log records, else one strip for the whole
    machine."""
    half = 0.5 * machine.geometry.working_width_m
    return (
        machine.switched_strips
        # Without recorded valves the machine works as a whole.
        if machine.switched_strips and log.has("sections_cmd")
        else (SectionStrip(-half, half, 1.0),)
    )


def find_open_strips(log: RunLog, machine: Machine) -> npt.NDArray[np.bool_]:
    """Returns which strips of `find_section_strips` were open in each row, (n, strips): the
    commands, delayed by the valve's delay."""
    if not (machine.switched_strips and log.has("sections_cmd")):
        return np.ones((len(log), 1), dtype=np.bool_)
    valves = LoggedValves(machine.sections)
    return np.array(
        # Valves open later than commanded, so their history is replayed.
        [
            valves.find_open_valves(time_s, stated)
            for time_s, stated in zip(
                log.time_s.tolist(), log.texts("sections_cmd").tolist(), strict=True
            )
        ]
    )


def _read_speed_mps(log: RunLog) -> Floats:
    """Returns the speed of each row (n,), m/s."""
    column = _find_speed_column(log)
    assert column is not None
    return log.numbers(column)


def _find_speed_column(log: RunLog) -> str | None:
    """Returns the column of the speed that the control loop used; for an imported log of another
    machine, the first column of speed."""
    # The loop's own log always has the speed that it used.
    stated = (
        SPEED_COLUMNS
        if log.meta is not None and "imported" in log.meta.extra
        else SPEED_COLUMNS[:1]
    )
    return next((column for column in stated if log.has(column)), None)


def _find_max_step_s(log: RunLog) -> float:
    """Returns the longest step between rows, s, that is no gap; foreign logs may have a row every
    few seconds."""
    return (
        # A slow logger has long intervals in normal work.
        max(MAX_ROW_STEP_S, MAX_GAP_FREE_MEAN_STEPS * log.step_s)
        if log.step_s > 0.5 * MAX_ROW_STEP_S
        else MAX_ROW_STEP_S
    )


def calc_applied_rate_kg_ha(log: RunLog) -> Floats:
    """Returns the applied rate (n,), kg/ha, with the scale's correction where the log has one."""
    trim = log.numbers("flow_trim")
    return np.asarray(
        # The trim is the correction that the scale has found for the flow model.
        log.numbers("applied_rate_kg_ha") * np.where(np.isfinite(trim), trim, 1.0),
        dtype=np.float64,
    )


def find_worked_rows(log: RunLog) -> npt.NDArray[np.bool_]:
    """Returns the rows (n,) in which the machine worked.

    Rows in the state working count, except rows off the field (no target) without flow. All rows of
    a log with neither state nor source count.
    """
    working = np.asarray(log.texts("state") == State.WORKING.value) | (not log.has("state"))
    off_field = np.asarray(log.texts("target_source") == TargetSource.NONE.value)
    # A turning shaft off the field still releases material.
    turning = (log.numbers("shaft_rpm_cmd") > 0.0) | (
        log.numbers("shaft_rpm") > MIN_TURNING_SHAFT_RPM
    )
    return np.asarray(working & (~off_field | turning), dtype=np.bool_)


def find_arrived_rows(log: RunLog) -> npt.NDArray[np.bool_]:
    """Returns the rows (n,) of work from the first row in which material left, or no target was
    set, as the totals count them."""
    arrival, found = MaterialArrival(), find_worked_rows(log)
    applied = np.nan_to_num(log.numbers("applied_rate_kg_ha")).tolist()
    for k, (works, rate, target) in enumerate(
        zip(found.tolist(), applied, log.numbers("target_rate_kg_ha").tolist(), strict=True)
    ):
        if works:
            found[k] = arrival.note_arrival(rate, None if target != target else target)
        else:
            arrival.stop_work()
    return found


def find_outlet_way(log: RunLog, machine: Machine) -> tuple[TangentPlane, Floats, Floats]:
    """Returns the plane, positions of the outlets (rows, 2), m, and headings (rows,), deg,
    interpolated between fixes. Raises ExportError for fewer than two positions."""
    time, lat, lon = log.time_s, log.numbers("lat_deg"), log.numbers("lon_deg")
    known = np.isfinite(lat) & np.isfinite(lon)
    # Fixes are less frequent than rows, so a repeated position is the previous fix.
    fresh = known & (np.diff(lat, prepend=np.nan) != 0.0) | known & (
        np.diff(lon, prepend=np.nan) != 0.0
    )
    if np.count_nonzero(fresh) < 2:
        raise ExportError(
            f"{log.path}: columns lat_deg, lon_deg: fewer than two places: allowed are two or more"
        )
    plane = TangentPlane(float(lat[known][0]), float(lon[known][0]))
    places = plane.project_many_to_m(lat[fresh], lon[fresh])
    antenna = np.column_stack([np.interp(time, time[fresh], places[:, k]) for k in (0, 1)])
    # The receiver's heading is better than the direction between positions at low speed.
    stated = log.numbers("heading_deg")
    if np.isfinite(stated).any():
        has = np.isfinite(stated)
        turned = np.interp(time, time[has], np.unwrap(np.radians(stated[has])))
    else:
        way = np.gradient(antenna, axis=0)
        turned = np.unwrap(np.arctan2(way[:, 0], way[:, 1]))
    ahead = np.column_stack((np.sin(turned), np.cos(turned)))
    # The outlets are behind the antenna along the heading.
    return plane, antenna - machine.geometry.antenna_m * ahead, np.degrees(turned) % 360.0


def _find_places_at(moments_s: Floats, time_s: Floats, way_m: Floats) -> Floats:
    """Returns positions (n, 2) at moments (n,), s; after the log's end they continue straight at
    its last speed."""
    # The last second of the log gives that speed.
    back = int(np.searchsorted(time_s, time_s[-1] - 1.0))
    # A log of one row has no speed, and its material stays in place.
    lasts = time_s[-1] - time_s[back]
    speed = (way_m[-1] - way_m[back]) / lasts if lasts > 0.0 else np.zeros(2)
    beyond = np.maximum(0.0, moments_s - time_s[-1])[:, None] * speed
    along = np.column_stack([np.interp(moments_s, time_s, way_m[:, k]) for k in (0, 1)])
    return np.asarray(along + beyond, dtype=np.float64)


def _gather_stretches(
    rows: _WorkedRows, strips: Sequence[SectionStrip], every_s: float
) -> WorkedStretches:
    """Returns the segments of all strips, sorted by time."""
    found = [
        _build_strip_stretches(
            _select_strip_rows(rows, strip, flowed), strip.right_m - strip.left_m, every_s
        )
        for strip, flowed in zip(strips, rows.opened.T, strict=True)
        if flowed.any()
    ]
    # One strip needs no sorting.
    if len(found) == 1:
        return found[0]
    together = [np.concatenate(columns) for columns in zip(*found, strict=True)]
    order = np.argsort(together[0], kind="stable")
    return WorkedStretches(*(column[order] for column in together))


def _select_strip_rows(
    rows: _WorkedRows, strip: SectionStrip, flowed: npt.NDArray[np.bool_]
) -> _WorkedRows:
    """Returns the rows in which a strip flowed, shifted to the strip's middle."""
    aside = 0.5 * (strip.left_m + strip.right_m)
    # The whole machine has its middle on the path.
    if aside == 0.0 and flowed.all():
        return rows
    angle = np.radians(rows.heading_deg)
    right = aside * np.column_stack((np.cos(angle), -np.sin(angle)))
    moved = rows._replace(begin_m=rows.begin_m + right, end_m=rows.end_m + right)
    return _WorkedRows._make((moved.plane, *(column[flowed] for column in moved[1:])))


# A segment consists of consecutive rows within one period, without a gap.
def _build_strip_stretches(rows: _WorkedRows, width: float, every_s: float) -> WorkedStretches:
    """Returns the segments of a strip."""
    # A gap ends a segment, because no material was recorded in it.
    breaks = np.diff(rows.time_s) > rows.step_s[1:] + 1e-6
    # The small number keeps a time of exactly a period in its own period.
    period = np.floor(rows.time_s / every_s + 1e-9)
    first = np.flatnonzero(np.concatenate(([True], breaks | (np.diff(period) != 0.0))))
    last = np.append(first[1:], len(rows.time_s)) - 1
    length = rows.speed_mps * rows.step_s
    area_ha = length * width / 10_000.0
    kg = np.add.reduceat(area_ha * rows.applied_kg_ha, first)
    known = np.isfinite(rows.target_kg_ha)
    target_kg = np.add.reduceat(np.where(known, area_ha * rows.target_kg_ha, 0.0), first)
    # The mean target uses only the ground with a known target.
    target_ha = np.add.reduceat(np.where(known, area_ha, 0.0), first)
    ha = np.add.reduceat(area_ha, first)
    duration = np.add.reduceat(rows.step_s, first)
    begin, end = rows.begin_m[first], rows.end_m[last]
    middle = 0.5 * (begin + end)
    centre = first + (last - first) // 2
    heading = rows.heading_deg[centre]
    corners = _calc_corners_m(begin, end, rows.heading_deg[first], rows.heading_deg[last], width)
    # A segment without any target divides zero by zero, which gives NaN as intended.
    with np.errstate(invalid="ignore", divide="ignore"):
        target = target_kg / target_ha
    lat_lon = _convert_to_deg(rows.plane, middle)
    return WorkedStretches(
        rows.time_s[last] - 0.5 * duration,
        lat_lon[:, 0],
        lat_lon[:, 1],
        _convert_to_deg(rows.plane, corners.reshape(-1, 2)).reshape(-1, 4, 2),
        heading,
        np.add.reduceat(length, first) / duration,
        duration,
        np.add.reduceat(length, first),
        10_000.0 * ha,
        target,
        kg / ha,
        target_kg,
        kg,
        rows.shaft_rpm[centre],
        rows.opening_mm[centre],
        rows.fix_quality[centre],
        rows.satellites[centre],
        rows.hdop[centre],
        np.add.reduceat(rows.effort_percent, first) / (last - first + 1),
        np.full(len(first), width),
    )


def _calc_corners_m(
    begin: Floats, end: Floats, from_deg: Floats, to_deg: Floats, width_m: float
) -> Floats:
    """Returns corners (n, 4, 2), m: left and right at the begin, right and left at the end."""

    def right(heading_deg: Floats) -> Floats:
        angle = np.radians(heading_deg)
        return 0.5 * width_m * np.column_stack((np.cos(angle), -np.sin(angle)))

    return np.stack(
        (
            begin - right(from_deg),
            begin + right(from_deg),
            end + right(to_deg),
            end - right(to_deg),
        ),
        axis=1,
    )


def _convert_to_deg(plane: TangentPlane, places: Floats) -> Floats:
    """Returns latitude and longitude (n, 2) of positions (n, 2), m."""
    return np.array([plane.convert_to_deg(east, north) for east, north in places.tolist()])


def _sum_log_rows(log: RunLog, machine: Machine, product: SpreadProduct) -> Totals:
    """Returns the sums of the log's own rows."""
    totaliser = Totaliser(machine.geometry.working_width_m, product.n_fraction)
    # The share of open sections scales the worked width.
    share = find_open_strips(log, machine) @ np.array(
        [strip.share for strip in find_section_strips(log, machine)]
    )
    time = log.time_s
    step = np.diff(time, prepend=time[:1])
    counts = find_arrived_rows(log) & (step <= _find_max_step_s(log))
    columns = (
        step,
        _read_speed_mps(log),
        calc_applied_rate_kg_ha(log),
        log.numbers("target_rate_kg_ha"),
        share,
    )
    for seconds, speed, applied, target, wide in zip(
        *(column[counts].tolist() for column in columns), strict=True
    ):
        totaliser.add_tick(
            seconds,
            # NaN is not equal to itself, and the totaliser expects None.
            None if speed != speed else speed,
            None if applied != applied else applied,
            None if target != target else target,
            wide,
        )
    for one in find_stopped_releases(log):
        totaliser.add_stopped(one.kg)
    return totaliser.make_totals()


def _find_limited_ground(
    log: RunLog, rows: _WorkedRows, strips: Sequence[SectionStrip]
) -> CropLimitedGround | None:
    """Returns the ground on which the target exceeded the crop's limit; None where it never did, or
    the limit is unknown."""
    # A foreign sidecar may have any content in place of a number.
    limit = ((log.meta.crop if log.meta else None) or {}).get("max_rate_kg_ha")
    if not isinstance(limit, int | float):
        return None
    above = rows.target_kg_ha > limit
    if not above.any():
        return None
    width_m = rows.opened @ np.array([strip.right_m - strip.left_m for strip in strips])
    ha = (rows.speed_mps * rows.step_s * width_m)[above] / 10_000.0
    wanted = rows.target_kg_ha[above]
    return CropLimitedGround(
        float(limit), float(ha.sum()), float(wanted.max()), float((ha * (wanted - limit)).sum())
    )


def _calc_one_rate_cost(log: RunLog, machine: Machine) -> WidthError | None:
    """Returns the cost of a single rate for the whole width, from the heads' readings while canopy
    was the source and material flowed; None where it cannot be computed."""
    by_canopy = np.asarray(
        log.texts("target_source") == TargetSource.CANOPY.value
    ) & find_worked_rows(log)
    by_canopy &= np.nan_to_num(log.numbers("applied_rate_kg_ha")) > 0.0
    heads = np.column_stack([log.numbers(name) for name in HEAD_COLUMNS[: machine.geometry.heads]])[
        by_canopy
    ]
    about = log.meta
    if len(heads) < 2 or about is None or about.crop is None:
        return None
    # Heads repeat their reading, and a repeated reading would count twice.
    new = np.concatenate(
        ([True], np.any(heads[1:] != heads[:-1], axis=1) & np.isfinite(heads[1:]).any(axis=1))
    )
    job = about.job or {}
    try:
        rule = prepare_rule(Crop.model_validate(about.crop), job.get("days"), job.get("ndvi_nrich"))
    # The days may need a weather file, or the sidecar may come from another program.
    except ValueError:
        return None
    return measure_width_error(rule, machine, heads[new])


def _cover_ground(
    rows: _WorkedRows, width_m: float, strips: Sequence[SectionStrip], flows: npt.NDArray[np.bool_]
) -> CoveredArea:
    """Returns the ground under the strips with flow in `flows` (n, strips), each place once, and
    the ground that was passed over again."""
    coverage = Coverage(
        width_m,
        # A narrow machine needs smaller cells to see its overlap.
        min(COVERAGE_CELL_M, width_m / 6.0),
        strips=[(one.left_m, one.right_m) for one in strips],
    )
    way_m = np.cumsum(rows.speed_mps * rows.step_s)
    gap = np.concatenate(([True], np.diff(rows.time_s) > rows.step_s[1:] + 1e-6))
    turns = np.concatenate(([False], np.any(flows[1:] != flows[:-1], axis=1)))
    last = np.concatenate((gap[1:], [True]))
    # An entry every half metre is accurate enough and keeps the raster fast.
    strides = np.diff(np.floor(way_m / COVER_STEP_M), prepend=-1.0) != 0.0
    for k in np.flatnonzero(gap | turns | last | strides).tolist():
        if gap[k]:
            coverage.extend_to(
                _to_place_pair(rows.begin_m[k]), float(rows.heading_deg[k]), (False,) * len(strips)
            )
        coverage.extend_to(
            _to_place_pair(rows.end_m[k]),
            float(rows.heading_deg[k]),
            # At a switch the previous state applies up to this position.
            flows[k - 1 if turns[k] else k].tolist(),
        )
    return coverage.covered_area


def _to_place_pair(place: Floats) -> Place:
    """Returns a position as a pair, m."""
    return float(place[0]), float(place[1])


def _count_doses(log: RunLog) -> tuple[int | None, int | None]:
    """Returns doses and misses of point mode from the log's events; None where point mode was not
    used."""
    words = [
        word for text in log.texts("events").tolist() if "dose" in text for word in text.split(";")
    ]
    # Only point mode writes such events.
    if not words:
        return None, None
    return (
        sum(word.startswith("dose ") for word in words),
        sum(word.startswith("dose_missed") for word in words),
    )


def _read_machine(log: RunLog) -> Machine:
    """Returns the machine of the log's sidecar. Raises ExportError for a sidecar without a
    machine."""
    if log.meta is None or log.meta.machine is None:
        raise ExportError(
            f"{log.path}: no machine file next to the log: allowed is a log with its NAME.yaml, "
            "or --machine"
        )
    try:
        return Machine.model_validate(log.meta.machine)
    except ValidationError as error:
        first = error.errors()[0]
        raise ExportError(
            f"{log.path.with_suffix('.yaml')}: machine: {'.'.join(map(str, first['loc']))}: "
            f"{first['msg']}"
        ) from None


def _check_machine_width(log: RunLog, machine: Machine) -> None:
    """Refuses a machine whose width differs from the width in the imported file, because areas are
    distances times its width. Raises ExportError."""
    imported = log.meta.extra.get("imported") if log.meta is not None else None
    stated = imported.get("width_m") if isinstance(imported, dict) else None
    width = machine.geometry.working_width_m
    # Areas scale with the width, so a wrong machine makes every area wrong.
    if isinstance(stated, int | float) and abs(width - stated) > SAME_WIDTH_TOLERANCE * stated:
        raise ExportError(
            f"{log.path}: worked {stated:g} m wide, as its file says, and machine {machine.id} is "
            f"{width:g} m wide: allowed is a machine file of that width (--machine)"
        )


def _read_product(log: RunLog) -> SpreadProduct:
    crop = (log.meta.crop if log.meta else None) or {}
    return SpreadProduct(
        str(crop.get("product", "product")), float(crop.get("product_n_fraction", 0.0))
    )


def _read_outline_deg(log: RunLog) -> Floats | None:
    """Returns the outline of the job's field (k, 2), latitude and longitude; None where the log has
    none."""
    ground = ((log.meta.job if log.meta else None) or {}).get("field") or {}
    corners = ground.get("boundary_m")
    if not corners:
        return None
    plane = TangentPlane(float(ground["origin_lat_deg"]), float(ground["origin_lon_deg"]))
    return _convert_to_deg(plane, np.asarray(corners, dtype=np.float64))


def _find_begin_utc(log: RunLog) -> dt.datetime | None:
    """Returns the UTC of time 0; None where the log has none."""
    texts = log.texts("utc")
    known = np.flatnonzero(texts != "")
    # The first known UTC fixes the zero of the log's time.
    if len(known):
        at = int(known[0])
        moment = _parse_utc_moment(str(texts[at]))
        return None if moment is None else moment - dt.timedelta(seconds=float(log.time_s[at]))
    return _parse_utc_moment(log.meta.started_utc) if log.meta and log.meta.started_utc else None


def _parse_utc_moment(text: str) -> dt.datetime | None:
    """Returns the UTC of an ISO 8601 text, which means UTC without a zone; None for an unreadable
    text."""
    try:
        moment = dt.datetime.fromisoformat(text)
    except ValueError:
        return None
    return moment.replace(tzinfo=dt.UTC) if moment.tzinfo is None else moment.astimezone(dt.UTC)

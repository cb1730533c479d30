"""How are ISO 11783-10 time logs (TLG) read? The binary records of a task controller become a table
for each log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from topdress.control.geodesy import TangentPlane
from topdress.drivers.files.columns import TIME_TYPE, Columns, count_rows
from topdress.drivers.files.exports.time_log import FIRST_DAY_UTC
from topdress.drivers.files.imports.device_description import (
    DeviceElement,
    NumberMeaning,
    find_contradiction,
    find_meaning,
    find_width_m,
    parse_ddi,
)
from topdress.drivers.files.imports.import_errors import LogImportError
from topdress.drivers.files.prescriptions.task_files import TaskSet

# Fields of TIM and its PTN that every record may hold, in their order: attribute, numpy's type,
# step, column name, and the number that means "unknown".
_HEAD_FIELDS = (
    ("PTN", "A", "<i4", 1e-7, "lat_deg", None),
    ("PTN", "B", "<i4", 1e-7, "lon_deg", None),
    ("PTN", "C", "<i4", 0.001, "altitude_m", None),
    ("PTN", "D", "u1", 1.0, "fix_quality", 15),
    ("PTN", "E", "<u2", 0.1, "pdop", 0xFFFF),
    ("PTN", "F", "<u2", 0.1, "hdop", 0xFFFF),
    ("PTN", "G", "u1", 1.0, "satellites", 0xFF),
    ("PTN", "H", "<u4", 0.001, "gps time of day s", None),
    ("PTN", "I", "<u2", 1.0, "gps day", None),
)
# Every record begins with milliseconds of the day and days since 1980.
_TIME_FIELDS = (("ms", "<u4"), ("day", "<u2"))
UTC_COLUMN = "utc"
# Data dictionary identifiers (ISO 11783-11) of total area (m2), width (mm) and work state (1:
# working).
TOTAL_AREA_DDI, WIDTH_DDI, WORK_STATE_DDI = 116, 67, 141
# Distance, m, below which two positions are equal.
MIN_STEP_M = 0.001


class LoggedValue(NamedTuple):
    """Describes a number that a log holds: its element (DET), its identifier, and its meaning by
    the device where that contradicts the dictionary."""

    ddi: int | None
    element: str
    part: DeviceElement | None
    meaning: NumberMeaning
    shown: NumberMeaning | None


@dataclass(frozen=True, eq=False)
class TimeLog:
    """Holds a time log. `task` is the id of the task (TSK). `heads` holds times and positions.
    `values` holds raw numbers (numbers, records), NaN before the first report.

    `lost` counts the bytes at the end that are no whole record. `trouble` is the reason why nothing
    can be read, in one line; empty for a readable log.
    """

    name: str
    task: str
    title: str
    logged: tuple[LoggedValue, ...] = ()
    heads: Columns | None = None
    values: NDArray[np.float64] | None = None
    lost: int = 0
    trouble: str = ""

    @property
    def rows(self) -> int:
        """Number of records."""
        # A log that could not be read has no records.
        return 0 if self.heads is None else count_rows(self.heads)

    @property
    def first_us(self) -> int:
        """First time, microseconds since 1970."""
        assert self.heads is not None
        return int(self.heads[UTC_COLUMN].min().astype(np.int64))

    @property
    def last_us(self) -> int:
        """Last time, microseconds since 1970."""
        assert self.heads is not None
        return int(self.heads[UTC_COLUMN].max().astype(np.int64))

    @property
    def devices(self) -> dict[str, str]:
        """Ids and names of the devices whose numbers the log holds."""
        return {
            one.part.device: one.part.device_name for one in self.logged if one.part is not None
        }


def read_time_logs(files: TaskSet, root: Element, parts: dict[str, DeviceElement]) -> list[TimeLog]:
    """Returns all time logs of all tasks, in the file's order."""
    return [
        _read_time_log(files, root, parts, task, name)
        for task in root.iter("TSK")
        for log in task.findall("TLG")
        if (name := log.get("A"))
    ]


def _read_time_log(
    files: TaskSet, root: Element, parts: dict[str, DeviceElement], task: Element, name: str
) -> TimeLog:
    # Name and title are known even if the files are missing, and they are shown to the operator.
    empty = TimeLog(name, task.get("A", ""), task.get("B", ""))
    layout, data = files.read(f"{name}.xml"), files.read(f"{name}.bin")
    # Data transfers are often copied without some of their files.
    if layout is None or data is None:
        absent = f"{name}.{'xml' if layout is None else 'bin'}"
        return _make_failed_log(empty, f"{absent}, which the task names, is not there")
    try:
        time = ElementTree.fromstring(layout)
    except ElementTree.ParseError as error:
        return _make_failed_log(empty, f"{name}.xml: not readable as XML: {error}")
    # Some terminals write the time element inside of another root.
    time = (
        time
        if time.tag == "TIM"
        else (found if (found := time.find(".//TIM")) is not None else time)
    )
    logged = tuple(_describe_value(root, parts, item) for item in time.findall("DLV"))
    place = time.find("PTN")
    # An attribute with an empty value is part of every record; an absent attribute is not.
    fields = [row for row in _HEAD_FIELDS if place is not None and place.get(row[1]) == ""]
    # The record's fixed part ends with the number of values that follow.
    head = np.dtype([*_TIME_FIELDS, *((row[4], row[2]) for row in fields), ("values", "u1")])
    starts, end = _find_record_starts(data, head.itemsize)
    if not len(starts):
        return _make_failed_log(
            TimeLog(empty.name, empty.task, empty.title, logged), "no record in it"
        )
    raw = np.frombuffer(data, np.uint8)
    # All heads are cut out at once, because a loop over records would take minutes.
    heads = raw[starts[:, None] + np.arange(head.itemsize)].view(head)[:, 0]
    # A record lists only changed values, so the columns are filled forward.
    values = _decode_values(raw, starts + head.itemsize, heads["values"], len(logged))
    return TimeLog(
        name, empty.task, empty.title, logged, _decode_heads(heads, fields), values, len(data) - end
    )


def _make_failed_log(log: TimeLog, why: str) -> TimeLog:
    """Returns a log that cannot be read, with the reason."""
    return TimeLog(log.name, log.task, log.title, log.logged, trouble=why)


def _decode_heads(
    heads: NDArray[np.void], fields: Sequence[tuple[str, str, str, float, str, int | None]]
) -> Columns:
    """Returns times and positions of the records as columns."""
    epoch = np.datetime64(FIRST_DAY_UTC.replace(tzinfo=None), "ms")
    times = epoch + heads["day"].astype("timedelta64[D]") + heads["ms"].astype("timedelta64[ms]")
    columns: Columns = {UTC_COLUMN: times.astype(TIME_TYPE)}
    nowhere = np.zeros(len(heads), np.bool_)
    if {"lat_deg", "lon_deg"} <= set(heads.dtype.names or ()):
        lat, lon = (
            heads["lat_deg"].astype(np.float64) * 1e-7,
            heads["lon_deg"].astype(np.float64) * 1e-7,
        )
        # Receivers without a fix report 0, 0.
        # Degrees beyond these limits come from damaged records.
        nowhere = ((lat == 0.0) & (lon == 0.0)) | (np.abs(lat) > 90.0) | (np.abs(lon) > 180.0)
    for _, _, _, step, name, unknown in fields:
        numbers = heads[name].astype(np.float64)
        numbers = numbers if unknown is None else np.where(numbers == unknown, np.nan, numbers)
        if name in ("lat_deg", "lon_deg"):
            numbers = np.where(nowhere, np.nan, numbers)
        columns[name] = numbers * step
    return columns


def _describe_value(root: Element, parts: dict[str, DeviceElement], item: Element) -> LoggedValue:
    ddi, part = parse_ddi(item.get("A", "")), parts.get(item.get("C", ""))
    return LoggedValue(
        ddi, item.get("C", ""), part, find_meaning(root, ddi, part), find_contradiction(ddi, part)
    )


def _find_record_starts(data: bytes, head_bytes: int) -> tuple[NDArray[np.int64], int]:
    """Returns the begin of each record, and the end of the last whole record; each record holds its
    own length."""
    starts, place, size = [], 0, len(data)
    while place + head_bytes <= size:
        # Each number has 5 bytes: its index and 32 bits.
        end = place + head_bytes + 5 * data[place + head_bytes - 1]
        # An incomplete last record is normal after a power loss.
        if end > size:
            break
        starts.append(place)
        place = end
    return np.array(starts, np.int64), place


def _decode_values(
    raw: NDArray[np.uint8], first: NDArray[np.int64], counts: NDArray[np.uint8], columns: int
) -> NDArray[np.float64]:
    """Returns numbers (columns, records), each the last reported number; NaN before the first."""
    out = np.full((columns, len(first)), np.nan)
    # The loop runs over the position of a value in its record, a few turns for any number of
    # records.
    for k in range(int(counts.max(initial=0))):
        rows = np.flatnonzero(counts > k)
        cells = raw[(first[rows] + 5 * k)[:, None] + np.arange(5)]
        which, value = cells[:, 0], np.ascontiguousarray(cells[:, 1:]).view("<i4")[:, 0]
        # An index beyond the layout comes from a damaged record.
        good = which < columns
        out[which[good], rows[good]] = value[good]
    # The index of the last known value is carried forward, and selects the value.
    last = (
        np.maximum.accumulate(np.where(np.isfinite(out), np.arange(out.shape[1]), 0), axis=1)
        if columns
        else None
    )
    return out if last is None else np.take_along_axis(out, last, axis=1)


def calc_worked_ha(log: TimeLog, parts: dict[str, DeviceElement]) -> tuple[float, str] | None:
    """Returns the covered area, ha, and its source: the device's own count, else distance times
    width while working. None for an unknown area."""
    if log.heads is None or log.values is None:
        return None
    # Several elements may count area, so the largest count is that of the whole machine.
    counted = [
        k
        for k, one in enumerate(log.logged)
        if one.ddi == TOTAL_AREA_DDI and np.isfinite(log.values[k]).any()
    ]
    if counted:
        areas = [
            # A counter that is reset makes a negative step, which is cut to zero.
            float(np.diff(values[np.isfinite(values)], prepend=np.nan)[1:].clip(0.0).sum())
            for values in (log.values[k] for k in counted)
        ]
        return max(areas) / 10_000.0, "counted"
    width = find_log_width(log, parts)
    if width is None or not {"lat_deg", "lon_deg"} <= set(log.heads):
        return None
    step = _calc_steps_m(log.heads)
    # If no element logs its work state, every record counts as work.
    works = [log.values[k] == 1.0 for k, one in enumerate(log.logged) if one.ddi == WORK_STATE_DDI]
    working = np.any(works, axis=0) if works else np.ones(len(step), np.bool_)
    return float(step[working].sum()) * width / 10_000.0, "way x width"


def find_log_width(log: TimeLog, parts: dict[str, DeviceElement]) -> float | None:
    """Returns the working width, m: the logged width if it is constant, else the width in the
    device's description; None for a changing width."""
    if log.values is not None:
        for k, one in enumerate(log.logged):
            known = log.values[k][log.values[k] > 0.0]
            if one.ddi == WIDTH_DDI and len(known):
                # A width that changed during the work has no single value.
                return float(known[0]) / 1000.0 if (known == known[0]).all() else None
    widths = [found for device in log.devices if (found := find_width_m(parts, device)) is not None]
    return max(widths) if widths else None


def _calc_steps_m(heads: Columns) -> NDArray[np.float64]:
    """Returns the distance to the previous position (n,), m; 0 where unknown."""
    lat, lon = heads["lat_deg"], heads["lon_deg"]
    known = np.isfinite(lat) & np.isfinite(lon)
    steps = np.zeros(len(lat))
    if known.sum() < 2:
        return steps
    # A plane at the first position is accurate to centimetres within a field.
    plane = TangentPlane(float(lat[known][0]), float(lon[known][0]))
    places = plane.project_many_to_m(lat[known], lon[known])
    steps[known] = np.concatenate(([0.0], np.hypot(*np.diff(places, axis=0).T)))
    # Smaller steps are the noise of a standing receiver.
    return np.where(steps > MIN_STEP_M, steps, 0.0)


def build_time_log_columns(
    log: TimeLog, names: dict[tuple[int | None, str], str], presented: bool
) -> Columns:
    """Returns times, positions and numbers as columns, in their units. `names` are by (DDI,
    element); numbers without a name are omitted. Raises LogImportError."""
    if log.heads is None or log.values is None:
        raise LogImportError(log.name, f"{log.trouble}")
    columns = dict(log.heads)
    for one, values in zip(log.logged, log.values, strict=True):
        name = names.get((one.ddi, one.element))
        if name is None:
            continue
        # The device's presentation is used only if the operator has chosen it.
        meaning = one.shown if presented and one.shown is not None else one.meaning
        columns[name] = values * meaning.step + meaning.offset
    return columns

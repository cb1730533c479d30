"""ISO 11783-10 time logs (TLG): the binary records that a task controller wrote, with what each number is."""
from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drivers.files.exports.time_log import FIRST_DAY
from drivers.files.findings import Finding
from drivers.files.imports.mapping import Source
from drivers.files.imports.raw import RawTable, unique
from drivers.files.imports.trouble import ImportTrouble, listed
from drivers.files.prescriptions.task_files import TaskFiles, find_task_files, task_tree
from drivers.files.prescriptions.words import PrescriptionError

# The fields of TIM and its PTN that every record tells, in their order in a record: attribute, type as numpy writes it,
# step, name here, the number that means not known.
_HEAD = (
    ("PTN", "A", "<i4", 1e-7, "lat_deg", None), ("PTN", "B", "<i4", 1e-7, "lon_deg", None),
    ("PTN", "C", "<i4", 0.001, "altitude_m", None), ("PTN", "D", "u1", 1.0, "fix_quality", 15),
    ("PTN", "E", "<u2", 0.1, "pdop", 0xFFFF), ("PTN", "F", "<u2", 0.1, "hdop", 0xFFFF),
    ("PTN", "G", "u1", 1.0, "satellites", 0xFF), ("PTN", "H", "<u4", 0.001, "gps time of day s", None),
    ("PTN", "I", "<u2", 1.0, "gps day", None))
_TIME = (("ms", "<u4"), ("day", "<u2"))
UTC = "utc"


class _Data(NamedTuple):
    """A number of ISO 11783-11: what it is called here, its unit, and how many of that unit one step is."""

    name: str
    unit: str
    step: float


_KNOWN = {
    6: _Data("target rate", "mg/m2", 1.0), 7: _Data("applied rate", "mg/m2", 1.0),
    41: _Data("target flow", "mg/s", 1.0), 42: _Data("applied flow", "mg/s", 1.0),
    67: _Data("working width", "mm", 1.0), 75: _Data("hopper", "g", 1.0), 141: _Data("work state", "", 1.0),
    397: _Data("speed", "mm/s", 1.0),
}


def read_task_log(path: Path, said: Source) -> RawTable:
    """A task's time log out of a task file, its folder or a zip. Raises ImportTrouble, OSError.

    A number that a record does not hold is the one last told, as logging on change means it.
    """
    try:
        files = find_task_files(path, said.inside)
        if files is None:
            raise ImportTrouble(f"{path}: no TASKDATA.XML there")
        root = task_tree(files)
        return _read(path, files, root, said)
    except PrescriptionError as error:
        raise ImportTrouble(str(error)) from None


def _read(path: Path, files: TaskFiles, root: Element, said: Source) -> RawTable:
    logs = [name for element in root.iter("TLG") if (name := element.get("A"))]
    if not logs:
        raise ImportTrouble(f"{path}: no time log (TLG) in its tasks: allowed is a task that was worked")
    chosen = said.task_log or (logs[0] if len(logs) == 1 else "")
    if chosen not in logs:
        raise ImportTrouble(f"{path}: {len(logs)} time logs: say source.task_log in the import file; allowed "
                            f"{listed(logs)}")
    layout, data = files.read(f"{chosen}.xml"), files.read(f"{chosen}.bin")
    if layout is None or data is None:
        absent = f"{chosen}.{'xml' if layout is None else 'bin'}"
        raise ImportTrouble(f"{path}: {absent}, which the task names, is not there")
    try:
        time = ElementTree.fromstring(layout)
    except ElementTree.ParseError as error:
        raise ImportTrouble(f"{path}: {chosen}.xml: not readable as XML: {error}") from None
    frame, units, lost = _frame(f"{path}: {chosen}", root, time, data)
    findings = (Finding("cut_row", f"{chosen}.bin: {lost} bytes at its end are no whole record: left out", rows=1),)
    source = said.model_copy(update={"kind": "isoxml", "task_log": chosen})
    return RawTable(path, frame, source, units, 1, findings if lost else ())


def _frame(label: str, root: Element, time: Element, data: bytes) -> tuple[pl.DataFrame, dict[str, str], int]:
    place = time.find("PTN")
    told = [row for row in _HEAD if place is not None and place.get(row[1]) == ""]
    head = np.dtype([*_TIME, *((row[4], row[2]) for row in told), ("values", "u1")])
    starts, end = _starts(data, head.itemsize)
    if not len(starts):
        raise ImportTrouble(f"{label}: no record in it")
    raw = np.frombuffer(data, np.uint8)
    heads = raw[starts[:, None] + np.arange(head.itemsize)].view(head)[:, 0]
    epoch = np.datetime64(FIRST_DAY.replace(tzinfo=None), "ms")
    times = epoch + heads["day"].astype("timedelta64[D]") + heads["ms"].astype("timedelta64[ms]")
    columns = [pl.Series(UTC, times).dt.replace_time_zone("UTC")]
    for _, _, _, step, name, unknown in told:
        numbers = heads[name].astype(np.float64)
        numbers = numbers if unknown is None else np.where(numbers == unknown, np.nan, numbers)
        columns.append(pl.Series(name, numbers * step, nan_to_null=True))
    logged = time.findall("DLV")
    known = [_told(root, item) for item in logged]
    names = unique([*(column.name for column in columns), *(one.name for one in known)])[len(columns):]
    units = {name: one.unit for name, one in zip(names, known, strict=True) if one.unit}
    columns += [pl.Series(name, values * one.step, nan_to_null=True).forward_fill() for name, one, values in
                zip(names, known, _values(raw, starts + head.itemsize, heads["values"], len(logged)), strict=True)]
    return pl.DataFrame(columns), units, len(data) - end


def _starts(data: bytes, head_bytes: int) -> tuple[NDArray[np.int64], int]:
    """Where each record begins, and where the last whole one ends: a record tells its own length."""
    starts, place, size = [], 0, len(data)
    while place + head_bytes <= size:
        end = place + head_bytes + 5 * data[place + head_bytes - 1]
        if end > size:
            break
        starts.append(place)
        place = end
    return np.array(starts, np.int64), place


def _values(raw: NDArray[np.uint8], first: NDArray[np.int64], counts: NDArray[np.uint8],
            columns: int) -> NDArray[np.float64]:
    """(columns, records), NaN where a record does not tell."""
    out = np.full((columns, len(first)), np.nan)
    for k in range(int(counts.max(initial=0))):
        rows = np.flatnonzero(counts > k)
        cells = raw[(first[rows] + 5 * k)[:, None] + np.arange(5)]
        which, value = cells[:, 0], np.ascontiguousarray(cells[:, 1:]).view("<i4")[:, 0]
        good = which < columns
        out[which[good], rows[good]] = value[good]
    return out


def _told(root: Element, item: Element) -> _Data:
    """What a logged number is: by the data dictionary, else by what the device calls it."""
    try:
        ddi = int(item.get("A", ""), 16)
    except ValueError:
        return _Data("no data identifier", "", 1.0)
    if ddi in _KNOWN:
        return _KNOWN[ddi]
    for process in root.iter("DPD"):
        if int(process.get("B", "0"), 16) == ddi:
            return _Data(process.get("E") or f"ddi {ddi}", "", 1.0)
    return _Data(f"ddi {ddi}", "", 1.0)



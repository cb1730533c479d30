"""Task sets of ISO 11783-10 as task controllers leave them behind: tasks, devices, one to
thirty time logs.

Shares no code with the reader: bytes are packed here from the standard's own layout. Each set
says what is true of it.
"""

from __future__ import annotations

import datetime as dt
import math
import random
import struct
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

DAY_ONE = dt.date(1980, 1, 1)
_LAT = math.radians(52.0)
# of the meridian, WGS84
METRES_A_DEGREE = 111_132.954 - 559.822 * math.cos(2 * _LAT) + 1.175 * math.cos(4 * _LAT)
SPEED_MPS = 2.5
KINDS = ("mass", "flow", "volume", "two bins", "sections", "mass", "mass")
ODD = ("", "", "", "cut", "gone", "empty", "overlap", "contradiction", "no place", "")
PACKED = ("folder", "zip", "deep zip", "small letters", "external")


@dataclass
class Log:
    """One time log: `records` (moment s, lat, lon, values by DLV), and what lies behind them."""

    name: str
    task: str
    begin_s: int
    rows: int
    rates_kg_ha: list[float] = field(default_factory=list)
    data: bytes = b""
    layout: str = ""


@dataclass
class TaskSet:
    number: int
    kind: str
    odd: str
    packed: str
    version: int
    width_m: float
    tasks: list[str]
    logs: list[Log]
    day: dt.date
    path: Path = Path()

    def truth(self, task: str) -> tuple[int, float, float]:
        """Rows, hectares and kilograms of a task, as the records say them at 1 s a record."""
        rows = hectares = kilograms = 0.0
        for log in self.logs:
            if log.task == task:
                rows += len(log.rates_kg_ha)
                area = SPEED_MPS * 1.0 * self.width_m / 10_000.0
                hectares += area * max(0, len(log.rates_kg_ha) - 1)
                kilograms += sum(rate * area for rate in log.rates_kg_ha[1:])
        return int(rows), hectares, kilograms


def task_set(number: int, folder: Path) -> TaskSet:
    """The set of that number, written below `folder`; the same number gives the same bytes."""
    dice = random.Random(number)
    kind, odd, packed = (
        KINDS[number % len(KINDS)],
        ODD[number % len(ODD)],
        PACKED[number % len(PACKED)],
    )
    count = 1 + number % 30
    tasks = [f"TSK{k + 1}" for k in range(min(count, 1 + (number // 7) % 3))]
    made = TaskSet(
        number,
        kind,
        odd,
        packed,
        3 + number % 2,
        dice.choice((12.0, 18.0, 24.0, 36.0)),
        tasks,
        [],
        dt.date(2024, 3, 1) + dt.timedelta(days=number),
    )
    begin_s = 7 * 3600
    for k in range(count):
        rows = dice.randint(40, 90)
        log = Log(f"TLG{k + 1:05d}", tasks[k * len(tasks) // count], begin_s, rows)
        _fill(made, log, dice, first=k == 0)
        made.logs.append(log)
        begin_s += rows + dice.randint(20, 200)
    _spoil(made)
    made.path = _written(made, folder)
    return made


def _fill(made: TaskSet, log: Log, dice: random.Random, first: bool) -> None:
    if made.odd == "empty" and first and made.number % 30:
        log.layout = _layout(made)
        return
    lat, lon = 52.0 + 0.01 * dice.random(), 9.0 + 0.01 * dice.random()
    rate, out = dice.choice((120.0, 150.0, 180.0)), bytearray()
    for k in range(log.rows):
        if k % 15 == 14:
            rate = float(dice.choice((90, 120, 150, 180, 210)))
        log.rates_kg_ha.append(rate)
        lat += SPEED_MPS / METRES_A_DEGREE
        nowhere = made.odd == "no place" and k < 3
        values = _values(made, rate, k)
        told = [
            (i, v)
            for i, v in enumerate(values)
            if not (i and k % 4 == 2 and _same(made, log, i, k))
        ]
        out += struct.pack(
            "<IHiiBHB",
            (log.begin_s + k) * 1000,
            (made.day - DAY_ONE).days,
            0 if nowhere else round(lat * 1e7),
            0 if nowhere else round(lon * 1e7),
            0 if nowhere else 4,
            8,
            14,
        )
        out.append(len(told))
        for i, value in told:
            out += struct.pack("<Bi", i, value)
    log.data, log.layout = bytes(out), _layout(made)


def _same(made: TaskSet, log: Log, column: int, row: int) -> bool:
    """Whether a value may be left out, as logging on change does: it is what the record before
    told."""
    return row > 0 and log.rates_kg_ha[row] == log.rates_kg_ha[row - 1] and column < 2


def _values(made: TaskSet, rate_kg_ha: float, row: int) -> list[int]:
    steps = round(rate_kg_ha * 100)
    speed = round(SPEED_MPS * 1000)
    if made.kind == "flow":
        flow = round(rate_kg_ha / 10_000.0 * SPEED_MPS * made.width_m * 1e6)
        return [flow, flow, speed, 1]
    if made.kind == "volume":  # as many l/ha: 0.01 mm3/m2 a step
        return [100 * steps, 100 * steps, speed, 1]
    if made.kind == "two bins":
        return [steps, steps, speed, 1, steps // 3]
    if made.kind == "sections":
        return [steps, steps, speed, 1, 1, 1 if row < 20 else 0]
    return [steps, steps, speed, 1]


def _dlvs(made: TaskSet) -> list[tuple[str, str]]:
    pair = {"flow": ("0029", "002A"), "volume": ("0001", "0002")}.get(made.kind, ("0006", "0007"))
    rows = [(pair[0], "DET2"), (pair[1], "DET2"), ("018D", "DET9"), ("008D", "DET1")]
    if made.kind == "two bins":
        rows.append(("0007", "DET3"))
    if made.kind == "sections":
        rows[3:] = [("008D", "DET4"), ("008D", "DET5"), ("008D", "DET6")]
    return rows


def _layout(made: TaskSet) -> str:
    head = '<PTN A="" B="" D="" F="" G=""/>'
    return (
        f'<TIM A="" D="4">{head}'
        + "".join(f'<DLV A="{a}" B="" C="{c}"/>' for a, c in _dlvs(made))
        + "</TIM>"
    )


def _spoil(made: TaskSet) -> None:
    last = made.logs[-1]
    if made.odd == "cut":
        last.data = last.data[:-7]
        last.rates_kg_ha.pop()
    elif made.odd == "gone":
        last.data = b"gone"
    elif made.odd == "overlap" and len(made.logs) > 1:
        alike = [log for log in made.logs if log.task == made.logs[0].task]
        if len(alike) > 1:
            alike[1].data = alike[0].data
            alike[1].rates_kg_ha = list(alike[0].rates_kg_ha)


def _device(made: TaskSet) -> str:
    scale = (
        "0.1"
        if made.odd == "contradiction" and made.kind in ("mass", "two bins", "sections")
        else "0.01"
    )
    sections = (
        "".join(
            f'<DET A="DET{4 + k}" B="{4 + k}" C="4" D="Section {k + 1}" E="{4 + k}" F="1">'
            '<DOR A="24"/></DET>'
            for k in range(3)
        )
        if made.kind == "sections"
        else ""
    )
    shown = (
        ""
        if made.kind in ("flow", "volume")
        else f'<DVP A="30" B="0" C="{scale}" D="1" E="kg/ha"/>'
    )
    rate = ' F="30"' if shown else ""
    return (
        '<DVC A="DVC1" B="Spreader" C="1.0" D="A00084000DE00001" F="00000000000001" '
        'G="FF000000406E65">'
        '<DET A="DET1" B="1" C="1" D="Spreader" E="1" F="0"><DOR A="23"/><DOR A="24"/></DET>'
        '<DET A="DET2" B="2" C="3" D="Bin 1" E="2" F="1"><DOR A="21"/><DOR A="22"/></DET>'
        '<DET A="DET3" B="3" C="3" D="Bin 2" E="3" F="1"><DOR A="21"/><DOR A="22"/></DET>'
        + sections
        + f'<DPD A="21" B="0006" C="3" D="1" E="Soll"{rate}/><DPD A="22" B="0007" C="1" '
        f'D="1" E="Ist"{rate}/>'
        f'<DPT A="23" B="0046" C="{round(made.width_m * 1000)}" D="Width"/><DPD A="24" '
        'B="008D" C="1" D="8" '
        'E="Work state"/>' + shown + "</DVC>"
        '<DVC A="DVC2" B="Tractor" C="1.0" D="A00084000DE00002" F="00000000000002" '
        'G="FF000000406E66">'
        '<DET A="DET9" B="1" C="1" D="Tractor" E="1" F="0"><DOR A="11"/></DET>'
        '<DPD A="11" B="018D" C="1" D="1" E="Speed"/></DVC>'
    )


def _written(made: TaskSet, folder: Path) -> Path:
    tasks = ""
    for name in made.tasks:
        logs = "".join(f'<TLG A="{log.name}" C="1"/>' for log in made.logs if log.task == name)
        tasks += f'<TSK A="{name}" B="Field {name[-1]}" G="4">{logs}</TSK>'
    head = (
        '<?xml version="1.0" encoding="UTF-8"?><ISO11783_TaskData '
        f'VersionMajor="{made.version}" VersionMinor="0" '
        'DataTransferOrigin="2" ManagementSoftwareManufacturer="test" '
        'ManagementSoftwareVersion="1" '
        'TaskControllerManufacturer="test" TaskControllerVersion="1">'
    )
    files: dict[str, bytes] = {}
    if made.packed == "external":
        files["TSK00001.XML"] = f"<XFC>{tasks}</XFC>".encode()
        tasks = '<XFR A="TSK00001" B="1"/>'
    files["TASKDATA.XML"] = (head + tasks + _device(made) + "</ISO11783_TaskData>").encode()
    for log in made.logs:
        files[f"{log.name}.XML"] = log.layout.encode()
        if log.data != b"gone":
            files[f"{log.name}.BIN"] = log.data
    if made.packed == "small letters":
        files = {name.lower(): data for name, data in files.items()}
    inside = {"zip": "TASKDATA/", "deep zip": f"export/{made.day}/TASKDATA/"}.get(made.packed)
    if inside is not None:
        path = folder / f"set{made.number:02d}.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in files.items():
                archive.writestr(inside + name, data)
        return path
    path = folder / f"set{made.number:02d}"
    path.mkdir()
    for name, data in files.items():
        (path / name).write_bytes(data)
    return path

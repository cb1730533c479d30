"""Deals dialects at random over a known true log and holds what is imported against the truth.

A deal is how some machine might have written the log: kind of file, delimiter, decimal sign,
encoding, title rows, language, units, way to tell the time, sign for a missing value, columns
left out. `told`: units stand in the header, so the file must come in by itself; else it may be
refused, and must come in by its guessed import file with the units put right by hand.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import numpy.typing as npt
import yaml
from topdress.control.log_row import DECIMALS
from topdress.drivers.files.read_log import read_log

from tests.command import topdress
from tests.geojson import feature, geojson

Floats = npt.NDArray[np.float64]
ROWS, STEP_S = 400, 0.1
BEGIN = dt.datetime(2026, 3, 17, 6, 30, tzinfo=dt.UTC)
ZONE = "Asia/Shanghai"
EXTRA = "x_engine_torque_nm"

# Column -> language -> names. German names carry accents, Chinese ones need GB 18030 or Unicode.
NAMES: dict[str, dict[str, tuple[str, ...]]] = {
    "lat_deg": {"en": ("Latitude", "lat"), "de": ("Breitengrad",), "zh": ("纬度",)},
    "lon_deg": {"en": ("Longitude", "lon", "Lng"), "de": ("Längengrad",), "zh": ("经度",)},
    "heading_deg": {"en": ("Heading", "Course"), "de": ("Fahrtrichtung",), "zh": ("航向角",)},
    "speed_mps": {
        "en": ("Speed", "Ground speed", "GPS Speed"),
        "de": ("Geschwindigkeit", "Fahrgeschwindigkeit"),
        "zh": ("速度", "车速"),
    },
    "wheel_speed_mps": {
        "en": ("Wheel speed", "Radar Speed"),
        "de": ("Radgeschwindigkeit",),
        "zh": ("轮速",),
    },
    "shaft_rpm_cmd": {
        "en": ("Shaft speed command", "Target shaft speed", "Metering shaft setpoint"),
        "de": ("Drehzahl Soll", "Solldrehzahl Dosierwelle"),
        "zh": ("目标转速", "排肥轴转速设定"),
    },
    "shaft_rpm": {
        "en": ("Shaft speed", "Metering shaft actual"),
        "de": ("Drehzahl Ist", "Istdrehzahl Dosierwelle"),
        "zh": ("实际转速", "排肥轴转速"),
    },
    "opening_mm_cmd": {
        "en": ("Gate setpoint", "Opening command"),
        "de": ("Schieberöffnung Soll",),
        "zh": ("开度指令",),
    },
    "opening_mm": {
        "en": ("Gate opening", "Opening actual"),
        "de": ("Schieberöffnung Ist", "Öffnung"),
        "zh": ("开度反馈",),
    },
    "hopper_kg": {
        "en": ("Hopper weight", "Bin weight"),
        "de": ("Behältergewicht", "Gewicht"),
        "zh": ("肥箱重量",),
    },
    "supply_v": {"en": ("Battery voltage", "Supply"), "de": ("Batteriespannung",), "zh": ("电压",)},
    "target_rate_kg_ha": {
        "en": ("Target Rate", "targetRate"),
        "de": ("Ausbringmenge Soll",),
        "zh": ("目标施肥量",),
    },
    "applied_rate_kg_ha": {
        "en": ("Applied Rate", "Rate actual"),
        "de": ("Ausbringmenge Ist",),
        "zh": ("实际施肥量",),
    },
    EXTRA: {"en": ("Engine torque",), "de": ("Motormoment",), "zh": ("发动机扭矩",)},
}
# Column -> unit as written -> how many of it one of the log's unit is.
UNITS: dict[str, dict[str, float]] = {
    "lat_deg": {"deg": 1.0, "°": 1.0},
    "lon_deg": {"deg": 1.0, "°": 1.0},
    "heading_deg": {"deg": 1.0, "°": 1.0},
    "speed_mps": {"m/s": 1.0, "km/h": 3.6, "mph": 2.2369362920544, "kn": 1.9438444924406},
    "wheel_speed_mps": {"m/s": 1.0, "km/h": 3.6, "mph": 2.2369362920544},
    "shaft_rpm_cmd": {"r/min": 1.0, "rpm": 1.0, "rad/s": np.pi / 30.0, "U/min": 1.0},
    "shaft_rpm": {"r/min": 1.0, "rpm": 1.0, "rad/s": np.pi / 30.0, "1/min": 1.0},
    "opening_mm_cmd": {"mm": 1.0, "cm": 0.1, "in": 1.0 / 25.4},
    "opening_mm": {"mm": 1.0, "cm": 0.1},
    "hopper_kg": {"kg": 1.0, "t": 0.001, "lb": 1.0 / 0.45359237},
    "supply_v": {"V": 1.0, "mV": 1000.0},
    "target_rate_kg_ha": {"kg/ha": 1.0, "lb/ac": 0.8921791, "g/m2": 0.1, "t/ha": 0.001},
    "applied_rate_kg_ha": {"kg/ha": 1.0, "lb/ac": 0.8921791, "g/m2": 0.1, "t/ha": 0.001},
    EXTRA: {"Nm": 1.0},
}
DIGITS = {
    "lat_deg": 8,
    "lon_deg": 8,
    "hopper_kg": 5,
    "target_rate_kg_ha": 6,
    "applied_rate_kg_ha": 6,
}
HOLEY = ("hopper_kg", "supply_v", "opening_mm", EXTRA)  # sensors that fall silent
MARKS = ("-9999", "65535", "", "NaN", "N/A", "-")
TIME_NAMES = {"en": ("Time", "timestamp"), "de": ("Zeit", "Zeitstempel"), "zh": ("时间",)}
DATE_NAMES = {"en": "Date", "de": "Datum", "zh": "日期"}
WORK_NAMES = {
    "en": ("Work switch", "Implement working"),
    "de": ("Arbeitsstellung",),
    "zh": ("作业状态",),
}
TITLES = {
    "en": ("Machine report", "Operator: J. Smith", "Field: North, 12.5 ha"),
    "de": ("Maschinenprotokoll", "Fahrer: Jörg Müller", "Schlag: Nord; 12,5 ha"),
    "zh": ("机器报告", "操作员：王伟", "地块：北"),
}
TIMES = (
    "seconds",
    "seconds_on",
    "ms",
    "unix_s",
    "unix_ms",
    "iso_z",
    "iso_offset",
    "local",
    "day_and_time",
    "over_midnight",
    "excel_day",
)


@dataclass(frozen=True)
class Deal:
    """How the log is written. `columns`: of the log; `units`, `names`: column -> as written in
    the header."""

    number: int
    kind: str
    language: str
    told: bool
    columns: tuple[str, ...]
    names: dict[str, str]
    units: dict[str, str]
    time: str
    mark: str
    work: str  # numbers, words, or none
    delimiter: str = ","
    comma: bool = False
    encoding: str = "utf-8"
    titles: int = 0
    unit_row: bool = False
    brackets: str = "[]"
    line_end: str = "\n"
    holes: dict[str, Floats] = field(default_factory=dict)


def true_log() -> dict[str, Floats]:
    """A run of a made-up machine, columns of the run log in its units, and whether it worked."""
    rng = np.random.default_rng(7)
    t = np.arange(ROWS) * STEP_S
    speed = 1.5 + 0.5 * np.sin(t / 6.0) + 0.2 * np.sin(t / 1.7)
    way = np.cumsum(speed) * STEP_S
    work = ((t > 4.0) & (t < 36.0)).astype(np.float64)
    target = np.repeat(rng.uniform(150.0, 450.0, ROWS // 20), 20)
    command = np.where(work > 0.0, np.repeat(rng.uniform(20.0, 60.0, ROWS // 16), 16), 0.0)
    gate = np.repeat(rng.uniform(12.0, 38.0, ROWS // 25), 25)
    shaft, opening = _followed(command, 0.35), _followed(gate, 0.5)
    # its noise makes rates below zero, as scales do
    applied = _followed(target, 0.6) * work
    return {
        "time_s": t,
        "lat_deg": 34.28 + way * np.cos(0.6) / 111_200.0,
        "lon_deg": 119.88 + way * np.sin(0.6) / (111_200.0 * np.cos(np.radians(34.28))),
        "heading_deg": np.full(ROWS, np.degrees(0.6)) + rng.normal(0.0, 0.2, ROWS),
        "speed_mps": speed,
        "wheel_speed_mps": speed * 1.03 + rng.normal(0.0, 0.01, ROWS),
        "shaft_rpm_cmd": command,
        "shaft_rpm": shaft + rng.normal(0.0, 0.1, ROWS),
        "opening_mm_cmd": gate,
        "opening_mm": opening + rng.normal(0.0, 0.02, ROWS),
        "hopper_kg": 620.0 - np.cumsum(shaft * opening) * 1e-4 + rng.normal(0.0, 0.05, ROWS),
        "supply_v": 13.4 + rng.normal(0.0, 0.05, ROWS),
        "target_rate_kg_ha": target,
        "applied_rate_kg_ha": applied + rng.normal(0.0, 0.5, ROWS),
        EXTRA: rng.normal(240.0, 20.0, ROWS),
        "work": work,
    }


def _followed(command: Floats, time_constant_s: float) -> Floats:
    """What follows a command in force from its row on, first order."""
    out = np.empty_like(command)
    out[0] = command[0]
    share = 1.0 - np.exp(-STEP_S / time_constant_s)
    for k in range(1, len(command)):
        out[k] = out[k - 1] + share * (command[k - 1] - out[k - 1])
    return out


def deal(number: int, seed: int = 1) -> Deal:
    rng = np.random.default_rng([seed, number])

    def one(choices: Any) -> Any:
        return list(choices)[int(rng.integers(len(list(choices))))]

    told = bool(rng.random() < 0.75)
    kind = one(("text",) * 7 + ("excel", "parquet", "geojson", "shapefile"))
    told = told and kind != "shapefile"
    language = "en" if kind == "shapefile" else one(("en", "de", "zh"))
    groups = [
        ("lat_deg", "lon_deg"),
        ("heading_deg",),
        ("speed_mps",),
        ("wheel_speed_mps",),
        ("shaft_rpm_cmd", "shaft_rpm"),
        ("opening_mm_cmd", "opening_mm"),
        ("hopper_kg",),
        ("supply_v",),
        ("target_rate_kg_ha", "applied_rate_kg_ha"),
        (EXTRA,),
    ]
    kept = [group for group in groups if rng.random() < 0.7] or [one(groups[4:6])]
    columns = [name for group in kept for name in group]
    if kind in ("geojson", "shapefile"):
        columns = [
            "lat_deg",
            "lon_deg",
            *(name for name in columns if name not in ("lat_deg", "lon_deg")),
        ]
        columns += [] if "speed_mps" in columns else ["speed_mps"]
    if not any(name not in ("lat_deg", "lon_deg", "heading_deg", EXTRA) for name in columns):
        columns += ["shaft_rpm_cmd", "shaft_rpm"]
    rng.shuffle(columns)
    delimiter = one(",;\t|")
    encodings = {
        "en": ("utf-8", "utf-8-sig", "utf-16", "latin-1"),
        "de": ("utf-8", "utf-8-sig", "utf-16", "latin-1"),
        "zh": ("utf-8", "utf-8-sig", "utf-16", "gb18030"),
    }[language]
    units = {name: one(UNITS[name]) for name in columns}
    times = [
        time for time in TIMES if kind == "text" or time not in ("over_midnight", "day_and_time")
    ]
    holes = {
        name: (rng.random(ROWS) < 0.03).astype(np.float64) for name in columns if name in HOLEY
    }
    names = {name: one(NAMES[name][language]) for name in columns}
    marks = MARKS[:2] if kind in ("shapefile", "geojson") else MARKS
    return Deal(
        number,
        kind,
        language,
        told,
        tuple(columns),
        names,
        units,
        one(times),
        one(marks),
        one(("numbers", "words", "none")),
        delimiter,
        bool(delimiter != "," and rng.random() < 0.5),
        one(encodings),
        int(rng.integers(0, 4)),
        bool(rng.random() < 0.3),
        one(("[]", "()", " ,")),
        one(("\n", "\r\n")),
        holes,
    )


def cells(of: Deal, truth: dict[str, Floats]) -> tuple[list[str], list[str], list[list[str]]]:
    """Names in the header, units of a unit row, columns of texts."""
    comma = of.comma and of.kind == "text"
    names, units, columns = [], [], []
    for name, word, texts in _times(of, truth["time_s"]):
        names.append(name)
        units.append(word)
        columns.append(texts)
    for name in of.columns:
        values = truth[name] * UNITS[name][of.units[name]]
        texts = [f"{value:.{DIGITS.get(name, 4)}f}" for value in values]
        if name in of.holes:
            texts = [
                of.mark if hole else text for text, hole in zip(texts, of.holes[name], strict=True)
            ]
        names.append(of.names[name])
        units.append(of.units[name])
        columns.append([text.replace(".", ",") for text in texts] if comma else texts)
    if of.work != "none":
        on, off = {
            "numbers": ("1", "0"),
            "words": {"en": ("on", "off"), "de": ("Ein", "Aus"), "zh": ("作业", "停止")}[
                of.language
            ],
        }[of.work]
        names.append(WORK_NAMES[of.language][of.number % len(WORK_NAMES[of.language])])
        units.append("")
        columns.append([on if value else off for value in truth["work"]])
    return names, units, columns


def _times(of: Deal, t: Floats) -> list[tuple[str, str, list[str]]]:
    name = TIME_NAMES[of.language][of.number % len(TIME_NAMES[of.language])]
    local = [BEGIN.astimezone(ZoneInfo(ZONE)) + dt.timedelta(seconds=float(s)) for s in t]
    utc = [BEGIN + dt.timedelta(seconds=float(s)) for s in t]
    dot = "," if of.comma and of.kind == "text" else "."
    unix = BEGIN.timestamp()
    night = [dt.datetime(2026, 1, 1, 23, 59, 50) + dt.timedelta(seconds=float(s)) for s in t]
    days = [
        (m.replace(tzinfo=None) - dt.datetime(1899, 12, 30)).total_seconds() / 86_400.0
        for m in local
    ]
    unit, texts = {
        "seconds": ("s", [f"{s:.2f}".replace(".", dot) for s in t]),
        "seconds_on": ("s", [f"{s + 719.4:.3f}".replace(".", dot) for s in t]),
        "ms": ("ms", [str(round(1000 * s) + 5300) for s in t]),
        "unix_s": ("", [f"{unix + s:.3f}".replace(".", dot) for s in t]),
        "unix_ms": ("", [str(round(1000 * (unix + s))) for s in t]),
        "iso_z": ("", [f"{m:%Y-%m-%dT%H:%M:%S}.{_ms(m)}Z" for m in utc]),
        "iso_offset": ("", [f"{m:%Y-%m-%d %H:%M:%S}.{_ms(m)}+08:00" for m in local]),
        "local": ("", [f"{m:%d.%m.%Y %H:%M:%S}.{_ms(m)}" for m in local]),
        "day_and_time": ("", [f"{m:%H:%M:%S}{dot}{_ms(m)}" for m in local]),
        "over_midnight": ("", [f"{m:%H:%M:%S}.{_ms(m)}" for m in night]),
        "excel_day": ("", [f"{day:.9f}".replace(".", dot) for day in days]),
    }[of.time]
    date = (
        [(DATE_NAMES[of.language], "", [f"{m:%Y/%m/%d}" for m in local])]
        if of.time == "day_and_time"
        else []
    )
    return [*date, (name, unit, texts)]


def _ms(moment: dt.datetime) -> str:
    return f"{moment.microsecond // 1000:03d}"


def write(of: Deal, truth: dict[str, Floats], folder: Path) -> Path:
    """The file as the deal has it."""
    names, units, columns = cells(of, truth)
    if of.told and not of.unit_row:
        left, right = (of.brackets[0], of.brackets[1]) if of.brackets != " ," else (", ", "")
        if of.brackets == " ," and of.delimiter == ",":
            left, right = "_", ""
        names = [
            f"{name}{'' if left in '_,' else ' '}{left}{unit}{right}" if unit else name
            for name, unit in zip(names, units, strict=True)
        ]
    unit_row = of.told and of.unit_row
    return {
        "text": _text,
        "excel": _excel,
        "parquet": _parquet,
        "geojson": _geojson,
        "shapefile": _shapefile,
    }[of.kind](of, folder, names, units if unit_row else None, columns)


def _text(
    of: Deal, folder: Path, names: list[str], units: list[str] | None, columns: list[list[str]]
) -> Path:
    rows = [list(TITLES[of.language][: of.titles][k : k + 1]) for k in range(of.titles)]
    rows += [names, *([units] if units else []), *map(list, zip(*columns, strict=True))]
    lines = [
        of.delimiter.join(f'"{cell}"' if of.delimiter in cell else cell for cell in row)
        for row in rows
    ]
    path = folder / f"deal{of.number}.csv"
    path.write_bytes((of.line_end.join(lines) + of.line_end).encode(of.encoding))
    return path


def _value(cell: str) -> Any:
    try:
        return float(cell)
    except ValueError:
        return cell or None


def _excel(
    of: Deal, folder: Path, names: list[str], units: list[str] | None, columns: list[list[str]]
) -> Path:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for k in range(of.titles):
        sheet.append([TITLES[of.language][k]])
    sheet.append(names)
    if units:
        sheet.append(units)
    for row in zip(*columns, strict=True):
        sheet.append([_value(cell) for cell in row])
    path = folder / f"deal{of.number}.xlsx"
    book.save(path)
    return path


def _as_said(of: Deal, names: list[str], units: list[str] | None) -> list[str]:
    """Where a kind of file has no row of units, they go into the names."""
    return (
        [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
        if units
        else names
    )


def _parquet(
    of: Deal, folder: Path, names: list[str], units: list[str] | None, columns: list[list[str]]
) -> Path:
    import polars as pl

    values = [[_value(cell) for cell in column] for column in columns]
    kept = [
        column if all(isinstance(value, float | None) for value in column) else texts
        for column, texts in zip(values, columns, strict=True)
    ]
    frame = pl.DataFrame(
        [
            pl.Series(name, column, strict=False)
            for name, column in zip(_as_said(of, names, units), kept, strict=True)
        ]
    )
    path = folder / f"deal{of.number}.parquet"
    frame.write_parquet(path)
    return path


def _places(
    names: list[str], columns: list[list[str]], of: Deal
) -> tuple[list[float], list[float], list[int]]:
    at = {
        key: next(k for k, name in enumerate(names) if name.startswith(of.names[key]))
        for key in ("lat_deg", "lon_deg")
    }
    rest = [k for k in range(len(names)) if k not in at.values()]
    return (
        [float(x) for x in columns[at["lat_deg"]]],
        [float(x) for x in columns[at["lon_deg"]]],
        rest,
    )


def _geojson(
    of: Deal, folder: Path, names: list[str], units: list[str] | None, columns: list[list[str]]
) -> Path:
    names = _as_said(of, names, units)
    lat, lon, rest = _places(names, columns, of)
    return geojson(
        folder / f"deal{of.number}.geojson",
        *(
            feature(
                [lon[row], lat[row]], "Point", **{names[k]: _value(columns[k][row]) for k in rest}
            )
            for row in range(ROWS)
        ),
    )


def _shapefile(
    of: Deal, folder: Path, names: list[str], units: list[str] | None, columns: list[list[str]]
) -> Path:
    import shapefile

    lat, lon, rest = _places(names, columns, of)
    short = {of.names[name]: SHORT[name] for name in of.columns if name in SHORT}
    names = [short.get(name, name.partition(" ")[0]) for name in names]
    path = folder / f"deal{of.number}.shp"
    with shapefile.Writer(str(path), shapeType=shapefile.POINT) as writer:
        for k in rest:
            if all(isinstance(_value(cell), float) for cell in columns[k]):
                writer.field(names[k], "N", 20, 9)
            else:
                writer.field(names[k], "C", 40)
        for row in range(ROWS):
            writer.point(lon[row], lat[row])
            writer.record(*(_value(columns[k][row]) for k in rest))
    return path


# Names in shapefiles have ten letters at most, and no units.
SHORT = {
    "heading_deg": "Heading",
    "speed_mps": "Speed",
    "wheel_speed_mps": "WheelSpd",
    "shaft_rpm_cmd": "ShaftCmd",
    "shaft_rpm": "ShaftSpd",
    "opening_mm_cmd": "GateCmd",
    "opening_mm": "GateAct",
    "hopper_kg": "Hopper",
    "supply_v": "Voltage",
    "target_rate_kg_ha": "TargetRate",
    "applied_rate_kg_ha": "AppldRate",
    EXTRA: "EngTorque",
}


def problems(of: Deal, truth: dict[str, Floats], folder: Path) -> list[str]:
    """Imports the deal by the command; one line for each thing that is not as the truth has it."""
    source, out = write(of, truth, folder), folder / f"out{of.number}.csv"
    first = topdress("import", source, "--out", out)
    arguments = ["import", str(source), "--out", str(out)]
    if of.told and of.time != "local":
        if first.exit_code != 0:
            return [f"told, but refused: {line}" for line in first.output.splitlines()]
    elif first.exit_code == 0:
        out.unlink()
        out.with_suffix(".yaml").unlink()
    elif out.exists() or out.with_suffix(".yaml").exists() or len(first.output.splitlines()) < 2:
        return ["refused, but something was written, or nothing said"]
    if not of.told or of.time == "local":
        by_hand = folder / f"deal{of.number}.import.yaml"
        guessed = topdress("import", source, "--guess", "--mapping", by_hand)
        if guessed.exit_code != 0:
            return [f"no guess: {guessed.output}"]
        _put_right(of, by_hand)
        again = topdress(*arguments, "--mapping", by_hand)
        if again.exit_code != 0:
            return [f"refused with its import file: {line}" for line in again.output.splitlines()]
    return _against_truth(of, truth, out)


def _put_right(of: Deal, by_hand: Path) -> None:
    """What the file does not tell and its owner knows: units, the zone; and nothing else."""
    data = yaml.safe_load(by_hand.read_text(encoding="utf-8"))
    for name, column in data["columns"].items():
        if not of.told and name in of.units and name not in ("lat_deg", "lon_deg", EXTRA):
            column["unit"] = of.units[name]
            column.pop("scale", None)
    if of.time == "ms":
        data["time"]["counts"] = "ms"
    if of.time == "local":
        data["time"]["zone"] = ZONE
    data["rows"] = "answer_next_row"
    by_hand.write_text(yaml.safe_dump(data, allow_unicode=True), encoding="utf-8")


def _against_truth(of: Deal, truth: dict[str, Floats], out: Path) -> list[str]:
    log = read_log(out)
    if len(log) != ROWS:
        return [f"{len(log)} rows of {ROWS}"]
    wrong = []
    if np.abs(log.time_s - truth["time_s"]).max() > 1.1e-3:
        wrong.append(f"time_s off by {np.abs(log.time_s - truth['time_s']).max():g} s")
    if of.time in ("unix_s", "unix_ms", "iso_z", "iso_offset", "local") and not str(
        log.texts("utc")[0]
    ).startswith("2026-03-17T06:30:00.000Z"):
        wrong.append(f"utc {log.texts('utc')[0]}")
    for name in of.columns:
        want = truth[name].copy()
        if name in of.holes:
            want[of.holes[name] > 0.0] = np.nan
        name_here = (
            name if name != EXTRA else next((c for c in log.columns if c.startswith("x_")), name)
        )
        got = log.numbers(name_here)
        wrong += column_wrong(name, of.units[name], got, want)
    if of.work != "none":
        working = (
            log.texts("state") == "working"
            if log.has("state")
            else log.numbers("work_switch") == 1.0
        )
        if (working != (truth["work"] > 0.0)).any():
            wrong.append("working rows differ")
    return wrong


def column_wrong(name: str, unit: str, got: Floats, want: Floats) -> list[str]:
    """What a column that was written with `unit` is off by, beyond the digits of what was dealt
    and what is kept."""
    if (np.isnan(got) != np.isnan(want)).any():
        return [
            f"{name}: {int(np.isnan(got).sum())} not known, {int(np.isnan(want).sum())} in truth"
        ]
    step = 10.0 ** -DIGITS.get(name, 4) / UNITS[name][unit]
    digit = 0.51 * (step + 10.0 ** -DECIMALS.get(name, 9))
    off = np.nanmax(np.abs(got - want))
    return [f"{name}: off by {off:g}"] if off > digit + 2e-6 * np.nanmax(np.abs(want)) else []

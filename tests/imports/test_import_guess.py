"""What the guess takes for sure, and what it asks."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import Result
from topdress.drivers.files.columns import make_text_column
from topdress.drivers.files.config import load_config
from topdress.drivers.files.foreign_logs import rename_log_header
from topdress.drivers.files.imports.column_vocabulary import (
    find_rate_role,
    find_subject,
    fold_column_name,
)
from topdress.drivers.files.imports.convert import convert_table
from topdress.drivers.files.imports.guess import guess_import_file
from topdress.drivers.files.imports.guess_columns import _read_values
from topdress.drivers.files.imports.mapping import IMPORT_KIND, Source
from topdress.drivers.files.imports.physical_checks import find_answer
from topdress.drivers.files.imports.raw_table import RawTable
from topdress.drivers.files.imports.table_header import split_unit_name
from topdress.drivers.files.imports.table_reader import read_raw_table
from topdress.drivers.files.imports.units import find_named_unit
from topdress.drivers.files.read_log import read_log

from tests.geojson import feature, geojson
from tests.places import DRIVES

ROWS = range(80)
COMMAND = [30 + 10 * (k // 9 % 3) + k // 20 for k in ROWS]
ANSWER = [30, *COMMAND[:-1]]  # a row later
LAT = [34.0 + 2.0 * k / 111_200.0 for k in ROWS]


def table(header: str, *columns: object) -> str:
    rows = zip(ROWS, *columns, strict=True)  # type: ignore[arg-type]
    return header + "\n" + "".join(",".join(str(cell) for cell in row) + "\n" for row in rows)


@pytest.mark.parametrize(("words", "known"), [(0, 10), (5, 5), (6, None), (9, None), (10, None)])
def test_a_column_is_of_numbers_where_half_of_it_is(words: int, known: int | None) -> None:
    cells = ["off"] * words + [f"{k}.5" for k in range(10 - words)]
    values = _read_values(RawTable(Path("a.csv"), {"x": make_text_column(cells)}, Source()), "x")
    assert (values.size, int(np.isfinite(values).sum())) == (
        (10, known) if known is not None else (0, 0)
    )


def test_a_command_is_one_whatever_it_drives(tmp_path: Path) -> None:
    """Of a speed that is read; where the reading does not follow it is another drive's."""
    path = tmp_path / "fan.csv"
    for answered, known in (
        (ANSWER, {"shaft_rpm", "shaft_rpm_cmd"}),
        (ANSWER[::-1], {"shaft_rpm"}),
    ):
        path.write_text(table("time_s,fan command rpm,tacho rpm", COMMAND, answered))
        assert set(guess_import_file(read_raw_table(path)).mapping.columns) == known


@pytest.mark.parametrize(
    ("content", "doubts"),
    [
        (table("time_s,Shaft command rpm,Shaft rpm", COMMAND, ANSWER), []),
        (
            table("time_s,rpm a,rpm b", ANSWER, COMMAND),
            ["columns.shaft_rpm_cmd: no word says that rpm b is the command"],
        ),
        (
            table("time_s,Shaft command rpm,Shaft actual rpm", ANSWER, COMMAND),
            ["columns.shaft_rpm_cmd: shaft_rpm moves 1"],
        ),
        (
            table("time_s,Shaft command rpm,Shaft actual rpm", COMMAND, COMMAND),
            ["rows: shaft_rpm moves in the very row"],
        ),
        (
            table("time_s,Motor PWM,Motor rpm", [4 * c for c in COMMAND], ANSWER),
            ["columns.shaft_rpm_cmd: no unit in the header: scaled by 0.25"],
        ),
        (
            table("time_s,Shaft rpm,Shaft rpm", [30] * 80, [30] * 80),
            ["columns.shaft_rpm: Shaft rpm (2) would fit as well"],
        ),
        (
            table("time_s,Gate opening %", COMMAND),
            ["columns.opening_mm: Gate opening % is in %", "columns: no column was"],
        ),
        (
            table("time_s,speed km/h,flow kg/min", COMMAND, ANSWER),
            ["columns.applied_rate_kg_ha: flow kg/min is a flow"],
        ),
        (table("time_s,lat,lon,speed", LAT, [119.0] * 80, [7.2] * 80), []),
        (
            table("time_s,lat,lon,speed m/s", LAT, [119.0] * 80, [7.2] * 80),
            ["columns.speed_mps: in m/s, as the header"],
        ),
        (
            table("time_s,speed", [1.2] * 80),
            ["columns.speed_mps: no unit in the header: taken for m/s"],
        ),
        (
            table("time_s,hopper kg", range(100, 180)),
            ["columns.hopper_kg: it grows nearly all the time"],
        ),
        (
            table("time_s,shaft rpm", [500000] * 80),
            ["columns.shaft_rpm: 80 of 80 values such as 500000 are beyond"],
        ),
        (table("k,shaft rpm", COMMAND), ["time: no column is called a time; k alone grows evenly"]),
        (table("Tiempo (s),Shaft command rpm,Shaft rpm", COMMAND, ANSWER), []),
        (table("lap (s),Shaft command rpm,Shaft rpm", COMMAND, ANSWER), []),
        (
            table("DutyCycle,RPM", [0 if k < 9 else 500 - 4000 // k for k in ROWS]),
            ["time: no column tells the time", "columns: RPM follows DutyCycle: is that"],
        ),
        (table("ms,Shaft command rpm,Shaft rpm", COMMAND, ANSWER), []),
        (
            table(
                "x,when,shaft rpm",
                [
                    f"03/04/2026 10:00:{k % 60:02d}" if k < 60 else f"03/04/2026 10:01:{k - 60:02d}"
                    for k in ROWS
                ],
                COMMAND,
            ),
            ["time: column when is not called a time, but reads as one"],
        ),
        (
            table(
                "x,Time,shaft rpm",
                [f"03/04/2026 10:{k // 60:02d}:{k % 60:02d}" for k in ROWS],
                COMMAND,
            ),
            ["time: %d/%m/%Y %H:%M:%S%.f and %m/%d/%Y %H:%M:%S%.f both read"],
        ),
    ],
    ids=range(20),
)
def test_doubts(content: str, doubts: list[str], written: Callable[..., Path]) -> None:
    found = [
        f"{'.'.join(doubt.key)}: {doubt.text}"
        for doubt in guess_import_file(read_raw_table(written(content))).doubts
    ]
    assert len(found) == len(doubts), found
    assert all(told.startswith(want) for told, want in zip(found, doubts, strict=True)), found


def test_of_commands_that_repeat_the_nearest_answer_counts() -> None:
    command = np.tile(np.repeat([20.0, 30.0, 45.0], 3), 40)
    for lag in (0, 1, 3):
        found = find_answer(command, np.roll(command, lag))
        assert found is not None and found.lag == lag


def test_a_unit_by_the_distance_between_the_places(written: Callable[..., Path]) -> None:
    """80 rows of 2 m each: 7.2 is km/h, 4.474 is mph, 2 is m/s."""
    for number, unit in ((7.2, "km/h"), (4.474, "mph"), (2.0, "m/s")):
        found = guess_import_file(
            read_raw_table(written(table("time_s,lat,lon,speed", LAT, [119.0] * 80, [number] * 80)))
        ).mapping
        assert found.columns["speed_mps"].unit == unit


@pytest.mark.parametrize(
    ("header", "subject"),
    [
        ("Engine speed [rpm]", None),
        ("PTO speed (rpm)", None),
        ("Motordrehzahl [U/min]", None),
        ("发动机转速（r/min）", None),
        ("Wheel speed [rpm]", None),
        ("Motor torque [Nm]", "effort"),
        ("Engine torque [Nm]", None),
        ("Motorstrom [A]", "effort"),
        ("current", "effort"),
        ("排肥电机电流 [mA]", "effort"),
        ("gate_current", "effort"),
        ("current_speed_kmh", "speed"),
        ("engine current", None),
        ("Tank pressure [bar]", None),
        ("Wind speed [m/s]", None),
        ("Acceleration", None),
        ("Sample rate", None),
        ("Arbeitsbreite [m]", "working width"),
        ("Geschwindigkeit", "speed"),
        ("Dosierwelle Drehzahl", "shaft"),
        ("Roller", "shaft"),
        ("Roll [deg]", "roll_deg"),
        ("leftSpeedRpm", "shaft"),
        ("排肥轴转速(r/min)", "shaft"),
        ("Ausbringmenge Soll kg/ha", "rate"),
        ("作业状态", "work"),
        ("Vitesse (km/h)", "speed"),
        ("Öffnung [mm]", "gate"),
        ("Radgeschwindigkeit", "wheel speed"),
        ("GPS Quality", "fix_quality"),
        ("Gewicht t", "hopper"),
    ],
)
def test_what_a_header_is_about(
    header: str, subject: str | None, written: Callable[..., Path]
) -> None:
    name, word = split_unit_name(header)
    unit = find_named_unit(word) if word else None
    found = find_subject(fold_column_name(name), unit.quantity if unit else None)
    assert (found.id if found else None) == subject


@pytest.mark.parametrize(
    ("cell", "name", "unit"),
    [
        ("Speed [km/h]", "Speed", "km/h"),
        ("speed_kmh", "speed", "kmh"),
        ("Drehzahl in U/min", "Drehzahl", "U/min"),
        ("leftSpeedRpm", "leftSpeed", "Rpm"),
        ("rate_kg_ha", "rate", "kg_ha"),
        ("Bin weight, lb", "Bin weight", "lb"),
        ("开度（毫米）", "开度", "毫米"),
        ("T", "T", None),
        ("lat", "lat", None),
        ("N-rate", "N-rate", None),
        ("Slope %", "Slope", "%"),
        ("shaft_rpm_cmd", "shaft_rpm_cmd", None),
    ],
)
def test_a_name_and_its_unit(cell: str, name: str, unit: str | None) -> None:
    assert split_unit_name(cell) == (name, unit)


TARGET_AND_APPLIED = [
    ("Tgt_Rate", "App_Rate"),
    ("Tgt_Rate", "Rate"),
    ("TARGETRATE", "APPLIEDRAT"),
    ("ControlRate", "AppliedRate"),
    ("Rt_Tgt_Ms", "Rt_Apd_Ms"),
    ("Tgt_Rate_l", "Apd_Rate_l"),
    ("Soll kg/ha", "Ist kg/ha"),
    ("Sollmenge", "Istmenge"),
    ("Dose_cible", "Dose_reel"),
    ("Dosis_obj", "Dosis_aplic"),
    ("taxa_alvo", "taxa_aplic"),
    ("dosaggio rate prevista", "rate erogata"),
    ("dawka zadana", "dawka wykonana"),
    ("Норма заданная", "Норма факт"),
    ("目标施肥量", "实际施肥量"),
    ("施用量设定", "施用量实际"),
    ("AppliedRate", "Rx Rate"),
]


@pytest.mark.parametrize(("first", "second"), TARGET_AND_APPLIED)
def test_target_and_applied_are_told_by_name(
    first: str, second: str, written: Callable[..., Path]
) -> None:
    """Both numbers alike, in either order: only the names tell; and a map with both columns
    takes the wanted one."""
    target, applied = (second, first) if "Applied" in first else (first, second)
    for names in ((first, second), (second, first)):
        found = guess_import_file(
            read_raw_table(written(table("time_s," + ",".join(names), [150] * 80, [150] * 80)))
        ).mapping
        assert found.columns["target_rate_kg_ha"].source == target
        assert found.columns["applied_rate_kg_ha"].source == applied
    assert (find_rate_role(target), find_rate_role(applied)) in {("wanted", "done"), ("wanted", "")}


@pytest.mark.parametrize("name", ["Rate", "Ausbringmenge kg/ha", "施肥量", "dose"])
def test_a_rate_of_which_no_word_tells_the_kind_is_asked(
    name: str, written: Callable[..., Path]
) -> None:
    found = guess_import_file(read_raw_table(written(table(f"time_s,{name}", [150] * 80))))
    assert "no word says whether" in found.doubts[0].text
    wanted = guess_import_file(
        read_raw_table(written(table("time_s,Tgt_Rate", [150] * 80)))
    ).mapping
    assert set(wanted.columns) == {"target_rate_kg_ha"}


@pytest.mark.parametrize(
    ("cell", "factor"),
    [
        ("Speed_mph_", 0.44704),
        ("Speed_km_h_", 1 / 3.6),
        ("SpeedMPH", 0.44704),
        ("speedkmh", 1 / 3.6),
        ("Speed km per h", 1 / 3.6),
        ("VEHSPDKPH", 1 / 3.6),
        ("Speed_MPH", 0.44704),
        ("Speed(mph)", 0.44704),
    ],
)
def test_a_unit_at_the_end_of_a_name_is_taken(
    cell: str, factor: float, written: Callable[..., Path]
) -> None:
    """By the import and by the reader of run logs alike; numbers that would as well be another
    unit's."""
    found = guess_import_file(
        read_raw_table(written(table(f"time_s,{cell}", [12 + k % 3 for k in ROWS])))
    )
    assert not found.doubts and set(found.mapping.columns) == {"speed_mps"}
    unit = find_named_unit(found.mapping.columns["speed_mps"].unit or "")
    assert unit is not None and unit.factor == pytest.approx(factor)
    plain = rename_log_header(("time_s", "x", cell.replace("VEHSPD", "SPEED")))
    assert ("speed_mps" in plain.names and plain.factors["speed_mps"] == pytest.approx(factor)) or (
        "speed_kmh" in plain.names and factor == 1 / 3.6
    )


@pytest.mark.parametrize("name", ["lamps", "temps", "Triumph"])
def test_a_word_that_ends_like_a_unit_is_a_word(name: str) -> None:
    assert split_unit_name(name) == (name, None) or name == "Triumph"


def test_a_written_guess_reads_back_as_it_was(
    written: Callable[..., Path], topdress: Callable[..., Result], tmp_path: Path
) -> None:
    for number, content in enumerate(
        (
            table('time_s,"Motor PWM ""raw""",Motor rpm,Note: a #b', COMMAND, ANSWER, ["x"] * 80),
            table(
                "time_s,Gate opening %,Work switch,Hopper kg",
                COMMAND,
                [k % 2 for k in ROWS],
                [-9999, *COMMAND[1:]],
            ),
        )
    ):
        source, place = written(content, f"{number}.csv"), tmp_path / f"{number}.yaml"
        assert topdress("import", source, "--guess", "--mapping", place).exit_code == 0
        assert (
            load_config(place, IMPORT_KIND).model
            == guess_import_file(read_raw_table(source)).mapping
        )


def _points(folder: Path, **columns: list[object]) -> Path:
    """GeoJSON of points 2 m apart, whose properties are numbers or texts as given."""
    return geojson(
        folder / "points.geojson",
        *(
            feature(
                [119.0, 34.0 + 2.0 * k / 111_200.0],
                "Point",
                **{name: values[k] for name, values in columns.items()},
            )
            for k in range(len(next(iter(columns.values()))))
        ),
    )


CLOCK = [f"12:{k // 60:02d}:{k % 60:02d}" for k in range(150)]
DIGITS = [120_000 + 100 * (k // 60) + k % 60 for k in range(150)]


@pytest.mark.parametrize(
    ("day", "time", "begins"),
    [
        (20_200_513, CLOCK, "2020-05-13T12:00:00"),
        (13_052_020, CLOCK, "2020-05-13T12:00:00"),
        (43_964, CLOCK, "2020-05-13T12:00:00"),
        (20_200_513.0, DIGITS, "2020-05-13T12:00:00"),
        ("2020-05-13", DIGITS, "2020-05-13T12:00:00"),
        (134, CLOCK, None),
        (None, DIGITS, None),
    ],
)
def test_a_day_in_numbers_beside_a_time(
    day: object, time: list[object], begins: str | None, tmp_path: Path
) -> None:
    """It was a fault of ours (a SchemaError), and digits such as 120059, 120100 were counted as
    seconds."""
    days = {} if day is None else {"DATE": [day] * 150}
    raw = read_raw_table(
        _points(tmp_path, **days, TIME=time, AppliedRate_kg_ha=[200.0 + k % 7 for k in range(150)])
    )
    found = guess_import_file(raw)
    assert found.is_sure, found.doubts
    log = convert_table(raw, found.mapping)
    us = log.columns["us"]
    assert set(np.diff(us)) == {1e6}
    assert log.kind == ("local" if begins else "relative")
    if begins:
        assert str(us[:1].astype("datetime64[us]").astype("datetime64[s]")[0]) == begins


def test_a_day_of_six_digits_is_asked_for(tmp_path: Path) -> None:
    found = guess_import_file(read_raw_table(_points(tmp_path, DATE=[50_620] * 150, TIME=CLOCK)))
    assert any("which is the day?" in doubt.text for doubt in found.doubts)


def test_counts_of_milliseconds_are_no_times_of_day(tmp_path: Path) -> None:
    found = guess_import_file(read_raw_table(_points(tmp_path, TIME=[50 * k for k in range(100)])))
    assert found.mapping.time.counts == "ms" or found.doubts


@pytest.mark.parametrize(
    "begin_s", [11 * 3600 + 50, 59 * 60 + 40, 23 * 3600 + 58 * 60 + 30, 24 * 3600 - 90]
)
def test_digits_of_a_clock_are_read_over_every_edge(begin_s: int, tmp_path: Path) -> None:
    """120959 and then 121000: over the minute's end, the hour's, the day's."""
    clock = [
        (s // 3600 % 24) * 10_000 + (s // 60 % 60) * 100 + s % 60
        for s in range(begin_s, begin_s + 150)
    ]
    assert (
        guess_import_file(read_raw_table(_points(tmp_path, TIME=clock))).mapping.time.format
        is not None
    )


@pytest.mark.parametrize("beyond", [(0, 60, 0), (0, 0, 60), (24, 0, 0)])
def test_what_no_clock_shows_is_no_time_of_day(
    beyond: tuple[int, int, int], tmp_path: Path
) -> None:
    """Digits that would run evenly as hours, minutes and seconds, were there minutes or seconds
    of 60, hours of 24."""
    hours, minutes, seconds = beyond
    clock = [
        (hours + t // 3600) * 10_000 + (minutes + t // 60 % 60) * 100 + seconds + t % 60
        for t in range(40, 100)
    ]
    found = guess_import_file(read_raw_table(_points(tmp_path, TIME=clock)))
    assert found.mapping.time.format is None, "no such time"


# --- Recordings of real drives: what their owner has to say of them, and what comes out
# ------------------------------

STAIRS = {
    "shaft_rpm_cmd": {"from": "motorCommand", "scale": 2.5},
    "shaft_rpm": {"from": "rightSpeedRpm"},
}
LOOP = {"shaft_rpm_cmd": {"from": "targetSpeed"}, "shaft_rpm": {"from": "leftSpeed"}}

# File, unsure lines of the guess, rows in the log, what is said by hand.
FILES = [
    ("wheelSpeedCalibration1.csv", 3, 27, {"columns": STAIRS}),
    ("wheelSpeedCalibration2.csv", 3, 103, {"columns": STAIRS}),
    (
        "wheelSpeedCalibration3.csv",
        3,
        511,
        {"columns": STAIRS | {"supply_v": {"from": "batteryVoltage", "unit": "mV"}}},
    ),
    ("testPid1.csv", 4, 872, {"columns": LOOP}),
    ("testPid2.csv", 3, 748, {"columns": LOOP}),
    ("testPid3.csv", 3, 476, {"columns": LOOP}),
]


@pytest.mark.parametrize(
    ("name", "unsure", "rows", "by_hand"), FILES, ids=[one[0] for one in FILES]
)
def test_a_recording_of_a_drive(
    name: str,
    unsure: int,
    rows: int,
    by_hand: dict[str, Any],
    topdress: Callable[..., Result],
    tmp_path: Path,
) -> None:
    place, out = tmp_path / "m.yaml", tmp_path / "log.csv"
    refused = topdress("import", DRIVES / name, "--out", out)
    assert (
        refused.exit_code == 2
        and not out.exists()
        and len(refused.output.splitlines()) == unsure + 1
    )
    assert topdress("import", DRIVES / name, "--guess", "--mapping", place).exit_code == 0
    guessed = yaml.safe_load(place.read_text(encoding="utf-8"))
    assert set(guessed["columns"]) == set(by_hand["columns"])
    place.write_text(yaml.safe_dump(guessed | by_hand), encoding="utf-8")
    result = topdress("import", DRIVES / name, "--mapping", place, "--out", out)
    assert result.exit_code == 0, result.output
    log = read_log(out)
    assert len(log) == rows
    raw = np.genfromtxt(DRIVES / name, delimiter=",", names=True)
    command, reading = by_hand["columns"]["shaft_rpm_cmd"], by_hand["columns"]["shaft_rpm"]
    assert guessed["rows"] == (
        "answer_in_row" if command["from"] == "motorCommand" else "answer_next_row"
    )
    first = 1 if guessed["rows"] == "answer_in_row" else 0
    assert np.array_equal(log.numbers("shaft_rpm")[first:], raw[reading["from"]])
    assert np.allclose(
        log.numbers("shaft_rpm_cmd")[: len(raw)], command.get("scale", 1.0) * raw[command["from"]]
    )
    assert np.median(np.diff(log.time_s)) == pytest.approx({"w": 1.1, "t": 0.011}[name[0]], rel=1.0)
    if "supply_v" in by_hand["columns"]:
        assert 7.0 < np.nanmedian(log.numbers("supply_v")) < 9.0


def text_at(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


STEPS = [(0.02 * k, 100 * (k // 20 % 3), 40 * (k // 20 % 3)) for k in range(120)]


def test_a_log_without_a_header_is_asked_about_by_every_command(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    """Import reads it, so that no other command may say that it must name its columns."""
    log = text_at(tmp_path / "bare.csv", "".join(f"{t:.2f},{u},{y}\n" for t, u, y in STEPS))
    for words in (
        ("machine", "--from", log, "--out", tmp_path / "m.yaml", "--yes"),
        ("diagnose", log),
        ("compare", "drive_alone", "drive_alone", log),
    ):
        said = topdress(*words)
        assert (
            said.exit_code == 2 and "--guess" in said.output and "must name" not in said.output
        ), said.output


def test_a_command_by_name_is_seen_where_the_time_is_called_as_ours(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    log = text_at(
        tmp_path / "mixed.csv",
        "time_s,commanded_rpm,feedback_rpm\n"
        + "".join(
            f"{t:.2f},{u},{y}\n"
            for t, u, y in zip(
                [row[0] for row in STEPS],
                [row[1] for row in STEPS],
                [0] * 3 + [row[1] for row in STEPS[:-3]],
                strict=True,
            )
        ),
    )
    said = topdress("machine", "--from", log, "--out", tmp_path / "m.yaml", "--yes")
    assert said.exit_code == 0, said.output


def test_where_no_command_is_the_next_step_is_said(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    log = text_at(
        tmp_path / "reading.csv",
        "Time (s),Motor Speed (RPM)\n"
        + "".join(f"{t:.2f},{y + k % 2}\n" for k, (t, _, y) in enumerate(STEPS)),
    )
    said = topdress("machine", "--from", log, "--out", tmp_path / "m.yaml", "--yes")
    assert (
        said.exit_code != 0 and "shaft_rpm_cmd: missing" in said.output and "--guess" in said.output
    )


def test_times_in_another_unit_than_the_header_says(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    log = text_at(
        tmp_path / "us.csv",
        "time_us,pwm,w\n" + "".join(f"{t / 40:.5f},{u},{y}\n" for t, u, y in STEPS),
    )
    said = topdress("import", log, "--guess", "--mapping", tmp_path / "g.yaml")
    assert "are the times in another unit?" in said.output and "sort the log" not in said.output


def test_a_command_that_is_not_seen_is_no_sure_guess(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    """A setpoint in turns a second is read as nothing known; the g of an acceleration is no
    gram; u and y are asked."""
    rows = range(60)
    brake, shaken, plain = (tmp_path / f"{name}.csv" for name in ("brake", "shaken", "plain"))
    brake.write_text(
        "time [s],velocity setpoint [Hz],velocity measured [Hz],load cell weight [g]\n"
        + "".join(f"{0.1 * k:.1f},{15 + k % 3},{14.2 + k % 3},{5 * k}\n" for k in rows)
    )
    shaken.write_text(
        "time [s],acceleration x [g],acceleration y [g]\n"
        + "".join(f"{0.1 * k:.1f},{0.01 * (k % 7):.2f},{1 + 0.01 * (k % 5):.2f}\n" for k in rows)
    )
    plain.write_text(
        "t,u,y\n" + "".join(f"{0.02 * k:.2f},{(k * 7) % 5},{40 - k % 11}\n" for k in rows)
    )
    said = topdress("import", brake, "--guess", "--mapping", tmp_path / "b.yaml").output
    assert "nothing is unsure" not in said and "velocity setpoint [Hz]" in said
    assert topdress("import", shaken, "--guess", "--mapping", tmp_path / "s.yaml").exit_code == 0
    assert (
        "hopper_kg"
        not in yaml.safe_load((tmp_path / "s.yaml").read_text(encoding="utf-8"))["columns"]
    )
    said = topdress("import", plain, "--guess", "--mapping", tmp_path / "p.yaml").output
    assert "y follows u: is that the command of a drive and this its reading?" in said
    assert '# shaft_rpm_cmd: {from: "u", scale: }' in (tmp_path / "p.yaml").read_text(
        encoding="utf-8"
    )


def test_a_switch_is_a_command_and_nanoseconds_are_times(tmp_path: Path) -> None:
    path = tmp_path / "incubator.csv"
    begin_ns = 1_608_572_942_720_306_900
    path.write_text(
        "time,heater_cmd_rpm,shaft_rpm\n"
        + "".join(
            f"{begin_ns + 3_000_000_000 * k},{k // 9 % 3 == 1},{20 + 5 * (k // 9 % 3 == 1)}\n"
            for k in ROWS
        )
    )
    mapping = guess_import_file(read_raw_table(path)).mapping
    assert mapping.time.counts == "unix_ns"
    columns = convert_table(read_raw_table(path), mapping).columns
    assert set(np.diff(columns["us"])) == {3e6}
    command = next(values for name, values in columns.items() if "cmd" in name)
    assert set(np.asarray(command, np.float64).tolist()) <= {0.0, 1.0, 5.0}


def test_the_command_of_a_tagged_export_is_the_controllers_output(tmp_path: Path) -> None:
    """Five lines of head, the tags in the third: what is read follows the output slowly."""
    path = tmp_path / "loop.txt"
    head = (
        "PROCESSDATA\tDATA\tyyyy-MM-dd\n8\t10\t2024-06-13 21:55:00\t80\n"
        "tagname\tFIC46.MV\tFIC46.PV\tFIC46.SV\tFIC46.MODE\ndesc\tOP\tread\twanted\tmode\n"
        "fsMax=1.6\tfsMin=0\n"
    )
    path.write_text(
        head
        + "".join(
            f"2024-06-13 {k // 60:02}:{k % 60:02}:00\t{k * 7 % 5}\t{900 - k % 11}\t{ANSWER[k]}\t1\n"
            for k in ROWS
        )
    )
    found = guess_import_file(read_raw_table(path))
    assert found.mapping.time.column == "tagname"
    assert [one.text for one in found.doubts if "FIC46" in one.text] == [
        "FIC46.PV follows FIC46.MV: is that the command of a drive and this its reading?"
    ]
    assert "FIC46.MV" in found.open["shaft_rpm_cmd"] and "FIC46.PV" in found.open["shaft_rpm"]


def test_a_further_column_of_times_is_no_drive_and_an_empty_one_raises_no_warning(
    tmp_path: Path,
) -> None:
    """The command is held; stamps of another clock rise with what follows it."""
    path = tmp_path / "stamps.csv"
    path.write_text(
        "time,pwm,stamp_time,sent,empty,speed raw\n"
        + "".join(
            f"{0.1 * k:.1f},{k // 20},{5 * (k // 3)},{1_700_000_000 + k},,{k // 20 * 3}\n"
            for k in ROWS
        )
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        doubts = [one.text for one in guess_import_file(read_raw_table(path)).doubts]
    assert "speed raw follows pwm: is that the command of a drive and this its reading?" in doubts

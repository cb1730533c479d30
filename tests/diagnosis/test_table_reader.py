"""Bench tables as files: recognised by their columns, refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from topdress.control.diagnosis.tables import diagnose_tables
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.machine import Machine
from topdress.drivers.files.bench_table import read_bench_table
from topdress.drivers.files.imports.import_errors import TableError

from tests.diagnosis.planted import check

HEADERS = {
    "lag": "shaft_rpm,lag_s\n10,2.1\n20,2.0\n",
    "catch": "shaft_rpm,opening_mm,duration_s,mass_kg\n20,25,30,1.4\n",
    "weigh": "plot,area_m2,target_kg,applied_kg\nA,600,22,23\n",
    "heads": "head,ndvi_reference,ndvi\n1,0.5,0.51\n",
    "place": "replicate,shaft_rpm,speed_kmh,miss_m\n1,10,4.25,0.2\n",
}


def written(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("kind", HEADERS)
def test_the_kind_is_read_off_the_columns(tmp_path: Path, kind: str) -> None:
    assert read_bench_table(written(tmp_path, HEADERS[kind])).kind == kind


@pytest.mark.parametrize("lag", ["lag_s", "drop_s", "response_s"])
def test_any_lag_column_will_do(tmp_path: Path, lag: str) -> None:
    table = read_bench_table(
        written(tmp_path, f"source,shaft_rpm,{lag}\nrig,10,1.5\nfield,20,1.4\nrig,30,\n")
    )
    assert (table.kind, table.label_column, table.rows) == ("lag", "source", 2)
    assert any("1 rows lack" in text for text in table.findings)


def test_what_stands_for_a_missing_value_is_none(tmp_path: Path) -> None:
    """Before, the whole table was refused: row 2, column lag_s: -999: allowed -5 to 60."""
    table = read_bench_table(written(tmp_path, "shaft_rpm,lag_s\n10,2.1\n20,-999\n40,1.9\n"))
    assert table.columns["lag_s"].tolist() == [2.1, 1.9]
    path = tmp_path / "table.csv"
    assert table.findings == (
        f"{path}: column lag_s: 1 value -999 emptied: not known",
        f"{path}: 1 rows lack a needed number and are left out",
    )


def test_speed_in_kmh_is_understood(tmp_path: Path) -> None:
    speed = read_bench_table(
        written(tmp_path, "shaft_rpm,speed_kmh,lag_m\n10,3.6,3.1\n20,7.2,5.9\n")
    ).find_speed_mps()
    assert speed is not None
    assert speed.tolist() == pytest.approx([1.0, 2.0])


@pytest.mark.parametrize(
    ("text", "kind", "named"),
    [
        ("a,b\n1,2\n", None, "no known kind of bench table"),
        ("shaft_rpm,lag_m\n10,3.1\n", "lag", "column speed_mps or speed_kmh: missing"),
        ("shaft_rpm,lag_s\n10,300\n", None, "row 1, column lag_s: 300: allowed -5 to 60"),
        ("shaft_rpm,lag_s\n10,\n20,\n", None, "column lag_s: holds no number"),
        ("shaft_rpm,lag_s\n", None, "no rows"),
        ("shaft_rpm,lag_s\n10,2\n", "run", "kind 'run': allowed lag, catch"),
        ("shaft_rpm,lag_s\n10,2\n", "catch", "column opening_mm: missing: a catch table needs it"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(
    tmp_path: Path, text: str, kind: str | None, named: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(TableError) as refused:
        read_bench_table(path, kind)
    message = str(refused.value)
    assert named in message
    assert str(path) in message
    assert "\n" not in message


def test_several_kinds_at_once_must_be_decided(tmp_path: Path) -> None:
    path = written(tmp_path, "shaft_rpm,speed_mps,lag_s,miss_m\n10,1.2,2.1,0.3\n")
    with pytest.raises(TableError, match="say which with --kind"):
        read_bench_table(path)
    assert read_bench_table(path, "place").kind == "place"


def test_no_table_and_a_table_twice_are_refused(tmp_path: Path) -> None:
    table = read_bench_table(written(tmp_path, HEADERS["lag"]))
    with pytest.raises(ValueError, match="no table given"):
        diagnose_tables([], Machine())
    with pytest.raises(ValueError, match="given twice"):
        diagnose_tables([table, table], Machine())


@pytest.mark.parametrize("kind", HEADERS)
def test_one_or_two_rows_say_nothing_but_do_not_fail(tmp_path: Path, kind: str) -> None:
    found = diagnose_tables([read_bench_table(written(tmp_path, HEADERS[kind]))], Machine())
    assert not found.causes
    shown = any(one.smallest_detectable.value is not None for one in found.not_shown)
    assert found.verdict == ("none" if shown else "not_judged")
    assert all(np.isfinite(channel.rmse) for channel in found.channels)


# --- A lag rig counts the drop from 2 r/min on, while the shaft speeds up: its tables accuse no
# sound machine --------

SPEEDS_RPM = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0)


def rig_table(path, machine, late_s=0.0, seed=3):
    """Ten repeats at each speed: the shaft begins, the first granule falls at the pace of the
    stream behind it."""
    rng, lines = np.random.default_rng(seed), ["replicate,shaft_rpm,response_s,drop_s"]
    for repeat in range(1, 11):
        for target in SPEEDS_RPM:
            t, rpm, step, way, begun = 0.0, 0.0, 0.0005, 0.0, None
            while way < 1.0:
                rate = (target - rpm) / machine.shaft.time_constant_s
                rpm += step * min(
                    max(rate, -machine.shaft.acceleration_rpm_s), machine.shaft.acceleration_rpm_s
                )
                t += step
                if rpm >= 2.0:
                    begun = t if begun is None else begun
                    way += step / calc_drop_s(machine.fall, rpm)
            heard = t - begun
            response = machine.shaft.dead_time_s + begun
            lines.append(
                f"{repeat},{target:g},{response + rng.normal(0, 0.008):.4f},"
                f"{heard + late_s + rng.normal(0, 0.02):.4f}"
            )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_bench_table(path)


@pytest.mark.parametrize(
    ("late_s", "said"),
    [
        pytest.param(0.0, {"names": []}, id="a sound machine is not accused"),
        pytest.param(
            0.15,
            {"names": ["lag.offset"], "sizes": {"lag.offset": pytest.approx(0.15, abs=0.02)}},
            id="what falls late is still found",
        ),
    ],
)
def test_a_rig_that_counts_from_2_rpm_on(tmp_path, late_s, said):
    check(diagnose_tables([rig_table(tmp_path / "rig.csv", Machine(), late_s)], Machine()), **said)

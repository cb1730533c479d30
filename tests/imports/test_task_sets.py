"""Task sets with one to thirty time logs: what is imported, asked and refused; areas, rates, kilograms and rows against
what the generator knows, geopandas, and isoxml."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import polars as pl
import pytest
from click.testing import Result

from drivers.files.config import load
from drivers.files.imports.convert import convert
from drivers.files.imports.devices import Meaning
from drivers.files.imports.guess import guess
from drivers.files.imports.join import joined
from drivers.files.imports.log_file import log_frame
from drivers.files.imports.mapping import IMPORT, Source
from drivers.files.imports.read import read_raw
from drivers.files.imports.time_logs import TOTAL_AREA, WIDTH, WORK, LoggedValue, TimeLog, hectares, width_of
from drivers.files.imports.trouble import ImportTrouble

SPEED_MPS = 2.5                 # of every set
Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def said_of(made: Any, task: str, plain: bool) -> Source:
    """What a user would say after the questions; plain: before them."""
    held = "ddi" if made.odd == "contradiction" and not plain else None
    return Source(task=None if plain else task, values_from=held)     # type: ignore[arg-type]


def questions(made: Any, task: str) -> str:
    """What has to be asked of a task though the task is named; empty: nothing."""
    logs = [log for log in made.logs if log.task == task]
    first = task == made.logs[0].task
    if made.odd == "gone" and made.logs[-1].task == task:
        return "is not there"
    if made.odd == "overlap" and first and len(logs) > 1:
        return "allowed are logs that follow one another"
    if made.kind in ("two bins", "volume"):
        return "would fit as well" if made.kind == "two bins" else "is a volume: the product's density"
    return "which says that the machine works" if made.kind == "sections" and len(logs) > 0 else ""


def hectares_by_geopandas(lat: Floats, lon: Floats, utc_s: Floats, width_m: float) -> float:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    there = np.isfinite(lat)
    places = geopandas.GeoSeries.from_xy(lon[there], lat[there], crs="EPSG:4326").to_crs("EPSG:32632")
    steps = places[1:].reset_index(drop=True).distance(places[:-1].reset_index(drop=True)).to_numpy()
    near = np.diff(utc_s[there]) < 1.5
    return float(steps[near].sum()) * width_m / 10_000.0 / 0.9996        # UTM's scale on its central meridian


@pytest.mark.parametrize("number", [
    pytest.param(number, marks=() if number in (0, 1, 5, 7, 13, 16, 28, 43) else pytest.mark.exam)
    for number in range(60)])
def test_a_set(number: int, tmp_path: Path, task_sets: ModuleType) -> None:
    made = task_sets.task_set(number, tmp_path)
    if len(made.tasks) > 1:
        with pytest.raises(ImportTrouble) as several:
            read_raw(made.path)
        assert f"{len(made.logs)} time logs of {len(made.tasks)} tasks" in several.value.lines[0]
        assert len(several.value.lines) == 1 + len(made.logs)
    if made.odd == "contradiction" and made.kind == "mass":
        with pytest.raises(ImportTrouble, match="--values-from ddi or presentation"):
            read_raw(made.path, Source(task=made.tasks[0]))
    for task in made.tasks:
        wanted = questions(made, task)
        try:
            raw = read_raw(made.path, said_of(made, task, plain=False))
        except ImportTrouble as trouble:
            assert wanted and wanted in str(trouble), trouble
            continue
        found = guess(raw)
        if wanted:
            assert any(wanted in doubt.text for doubt in found.doubts), found.doubts
            continue
        assert found.sure, found.doubts
        frame = log_frame(joined([convert(raw, found.mapping)], found.mapping.join))
        rows, hectares, kilograms = made.truth(task)
        lost = 1 if made.odd == "cut" and made.logs[-1].task == task else 0
        assert frame.height == rows and sum("no whole record" in str(one) for one in raw.findings) == lost
        time_s = frame["time_s"].cast(float).to_numpy()
        at_work = np.diff(time_s, prepend=-9.0) < 1.5
        rate = frame["applied_rate_kg_ha"].to_numpy()
        area = np.where(at_work, frame["speed_mps"].to_numpy() * made.width_m / 10_000.0, 0.0)
        assert float(area.sum()) == pytest.approx(hectares, abs=1e-9)
        places = hectares_by_geopandas(frame["lat_deg"].to_numpy(), frame["lon_deg"].to_numpy(), time_s, made.width_m)
        without = sum(3 for log in made.logs if log.task == task and log.rates_kg_ha) if made.odd == "no place" else 0
        assert places == pytest.approx(hectares - without * SPEED_MPS * made.width_m / 10_000.0, rel=1e-4)
        assert float((area * rate).sum()) == pytest.approx(kilograms, rel=1e-4)


def test_as_isoxml_sees_it(tmp_path: Path, task_sets: ModuleType) -> None:
    """The library's tasks, logs, devices and bytes are ours; a time log's numbers it does not read."""
    pytest.importorskip("isoxml", reason="isoxml is not installed")
    from isoxml.models.ddi_entities import DDEntity
    from isoxml.util.isoxml_io import isoxml_from_path

    from drivers.files.imports.devices import DICTIONARY
    from drivers.files.imports.task_log import task_logs
    from drivers.files.imports.units import unit_named
    made = task_sets.task_set(20, tmp_path)
    theirs, files = isoxml_from_path(made.path / "TASKDATA.XML")
    ours = task_logs(made.path)
    assert ours is not None
    assert [(log.task, log.name) for log in ours.logs] == [
        (task.id, log.filename) for task in theirs.tasks for log in task.time_logs]
    assert all(len(files[log.name]) > 20 * log.rows for log in ours.logs)
    assert sorted(ours.parts) == sorted(element.id for device in theirs.devices for element in device.elements)
    for ddi, meaning in DICTIONARY.items():
        book = DDEntity.from_id(ddi)
        if meaning.unit in ("mg/m2", "mg/s", "mm", "mm/s", "g", "kg", "m2", "s") and book.unit != "n.a.":
            assert book.unit.replace("²", "2") == meaning.unit and book.bit_resolution == meaning.step, (ddi, book)
        assert not meaning.unit or unit_named(meaning.unit) is not None


def test_the_commands(topdress: Callable[..., Result], tmp_path: Path, task_sets: ModuleType) -> None:
    """Asked with a line for each log; chosen by task, device and log; and by what --guess writes."""
    made = task_sets.task_set(31, tmp_path)
    asked = topdress("import", made.path, "--out", tmp_path / "a.csv")
    lines = asked.output.splitlines()
    assert asked.exit_code == 2 and "say which with --task, --device and --log" in lines[0]
    assert "task TSK1 (Field 1), log TLG00001, device DVC1 (Spreader), DVC2 (Tractor): 2024-04-01 07:00:00" in lines[1]
    assert " rows, " in lines[1] and " ha (way x width); target rate, applied rate, speed, work state" in lines[1]
    nobody = topdress("import", made.path, "--task", "North", "--out", tmp_path / "a.csv")
    assert nobody.exit_code == 2 and "task North: no such time log" in nobody.output
    guessed = topdress("import", made.path, "--task", "Field 2", "--guess", "--mapping", tmp_path / "m.yaml")
    assert guessed.exit_code == 0 and "DET3 is Bin 2 of Spreader" in guessed.output
    mapping = load(tmp_path / "m.yaml", IMPORT).model
    assert mapping.source.task == "Field 2" and mapping.source.task_log is None
    done = topdress("import", made.path, "--mapping", tmp_path / "m.yaml", "--out", tmp_path / "a.csv")
    assert done.exit_code == 0 and f"{len(made.logs[1].rates_kg_ha)} rows" in done.output
    tractor = topdress("import", made.path, "--task", "TSK1", "--device", "Tractor", "--out", tmp_path / "t.csv")
    assert tractor.exit_code == 0 and "applied_rate" not in tractor.output and "speed_mps" in tractor.output
    one = task_sets.task_set(21, tmp_path)
    single = topdress("import", one.path, "--log", "TLG00003", "--out", tmp_path / "s.csv")
    assert single.exit_code == 0 and f"{len(one.logs[2].rates_kg_ha)} rows" in single.output


def logged(**numbers: tuple[int, list[float]]) -> TimeLog:
    """A log of twenty records, a metre and a bit apart, with these numbers: identifier and raw values."""
    count = 20
    heads = pl.DataFrame({"lat_deg": 52.0 + np.arange(count) * 1e-5, "lon_deg": np.full(count, 9.0)})
    values = [LoggedValue(ddi, "DET1", None, Meaning(name), None) for name, (ddi, _) in numbers.items()]
    return TimeLog("TLG00001", "TSK1", "", tuple(values), heads,
                   np.array([np.resize(np.array(raw, np.float64), count) for _, raw in numbers.values()]))


def test_the_hectares_of_a_log_are_its_devices_count_else_way_times_logged_width() -> None:
    """Widths are logged in mm, areas in m2; a width that changes is none; what is driven lifted does not count."""
    way_m = 19 * 1e-5 * 111_267.0           # of latitude at 52 degrees, m
    wide = logged(width=(WIDTH, [18_000.0]))
    assert width_of(wide, {}) == 18.0
    area = hectares(wide, {})
    assert area is not None and area[1] == "way x width" and area[0] == pytest.approx(way_m * 18.0 / 1e4, rel=2e-3)
    half = hectares(logged(width=(WIDTH, [18_000.0]), work=(WORK, [1.0, 0.0])), {})
    assert half is not None and half[0] == pytest.approx(area[0] * 9 / 19, rel=1e-3)
    counted = hectares(logged(width=(WIDTH, [18_000.0]), area=(TOTAL_AREA, list(5e4 + 250.0 * np.arange(20)))), {})
    assert counted == (pytest.approx(19 * 250.0 / 1e4), "counted")
    assert width_of(logged(width=(WIDTH, [18_000.0, 9_000.0])), {}) is None
    assert hectares(logged(work=(WORK, [1.0])), {}) is None

"""Everything tried, a line a kind: how many files, imported, asked, refused with which line; and sums by others.

    python benchmarks/files_tried.py [FOLDER ...] [--lines]

Maps in FOLDER (searched through) are read by `read_prescription`, what is no map by the import of logs; tables also by
every command that could take them. Areas and kilograms of shapefiles and GeoJSON are held against geopandas in an
equal-area projection; every map is written as a task, read again by isoxml and held against the public schema by
xmlschema (all of the dev extra). Places of receivers are held against pynmea2. Without FOLDER: the shared data.
Ends with code 1 where anything gave a traceback or differed.
"""
from __future__ import annotations

import argparse
import contextlib
import re
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from console.cli import app
from control.targets.map_check import map_check
from control.targets.prescription import statistics
from drivers.devices.decode import decode
from drivers.files.any_log import open_log
from drivers.files.prescriptions.csv_zones import holds_polygons
from drivers.files.prescriptions.read import read_prescription
from drivers.files.prescriptions.words import Choice, Imported, PrescriptionError, RateQuestion
from drivers.files.prescriptions.write import write_prescription

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
MAPS = (".shp", ".geojson", ".json", ".zip")
LOGS = (".csv", ".xlsx", ".parquet")
RECORDINGS = (".log", ".nmea", ".ubx")
COLUMNS = ("imported", "asked", "refused", "not judged", "TRACEBACK", "differ")
SHARE_OFF = 1e-3            # of the kilograms: projections and rounded rates


def files_in(folder: Path) -> list[Path]:
    """Maps, tasks (their folder) and tables."""
    found = [path.parent for path in folder.rglob("*") if path.name.lower() == "taskdata.xml"]
    return sorted({*found, *(path for path in folder.rglob("*") if path.suffix.lower() in (*MAPS, *LOGS))})


def tried(path: Path) -> tuple[str, str, str, Imported | None]:
    """Kind, what became of it, the line that was said, the map."""
    if path.suffix.lower() in LOGS and not (path.suffix.lower() == ".csv" and holds_polygons(path)):
        try:
            log = open_log(path)
        except (ValueError, OSError) as error:
            line = str(error).splitlines()[0]
            return f"table {path.suffix}", "asked" if "not opened" in str(error) else "refused", line, None
        return f"table {path.suffix}", "imported", f"{len(log)} rows, {log.duration_s:.0f} s", None
    kind = "task" if path.is_dir() else f"map {path.suffix}"
    try:
        read = read_prescription(path)
    except RateQuestion as error:
        return kind, "asked", str(error), answered(path)
    except (PrescriptionError, OSError) as error:
        return kind, "refused", str(error), None
    shares = statistics(read.data)
    area, mass = sum(s.area_ha for s in shares), sum(s.mass_kg for s in shares)
    return kind, "imported", f"{read.rate_from}, {read.unit}: {area:.4f} ha, {mass:.2f} kg", read


def answered(path: Path) -> Imported | None:
    """The map of a file that asks which of a task's rates, or what a litre weighs: one answer will do."""
    for choice in (Choice(rate_from="ddi"), Choice(density_kg_l=1.0)):
        with contextlib.suppress(PrescriptionError, OSError):
            return read_prescription(path, choice)
    return None


def by_geopandas(read: Imported, path: Path) -> str:
    """Area and mass by somebody else's reader and projection; empty: no such reader here."""
    try:
        import geopandas
    except ImportError:
        return ""
    if path.is_dir() or path.suffix.lower() not in (".shp", ".geojson", ".json"):
        return ""
    try:
        frame = geopandas.read_file(path)
    except (ValueError, RuntimeError) as error:
        return f"geopandas cannot read it ({type(error).__name__})"
    column = read.layers[0]
    if column not in frame.columns:
        return ""
    frame = frame.set_crs(4326) if frame.crs is None else frame
    west, south, east, north = frame.to_crs(4326).total_bounds
    equal_area = f"+proj=laea +lat_0={(south + north) / 2} +lon_0={(west + east) / 2} +datum=WGS84"
    frame = frame[frame.geometry.notna()].to_crs(equal_area)
    ha = frame.geometry.area / 1e4
    rates = frame[column].astype(str).str.extract(r"([-+\d.,]+)")[0].str.replace(",", ".").astype(float)
    return f"geopandas {ha[rates.notna()].sum():.4f} ha, {(ha * rates * read.factor).sum():.2f} kg"


def schema() -> Any:
    try:
        import isoxml_writer
        import xmlschema
    except ImportError:
        return None
    return xmlschema.XMLSchema(str(Path(isoxml_writer.__file__).parent / "ISOXML_schema/ISO11783_TaskFile_V4-3.xsd"))


def by_isoxml(folder: Path, fields_deg: Sequence[Sequence[Any]] = ()) -> tuple[float, float] | None:
    """Area and kilograms of a written task by the package isoxml, in an equal-area projection, inside the
    field where there is one; None: not there."""
    try:
        import numpy as np
        import pyproj
        import shapely
        from isoxml.converter.np_grid import to_numpy_array
        from isoxml.converter.shapely_geom import ShapelyConverterV4
        from isoxml.util.isoxml_io import isoxml_from_path
    except ImportError:
        return None
    task_data, files = isoxml_from_path(folder / "TASKDATA.XML")
    [task] = task_data.tasks
    code = {zone.code: zone.process_data_variables[0].process_data_value / 100.0 for zone in task.treatment_zones
            if zone.process_data_variables}
    shapes = [(ShapelyConverterV4().to_shapely_polygon(polygon), code[zone.code]) for zone in task.treatment_zones
              for polygon in zone.polygons]
    for grid in task.grids:
        lat, lon = float(grid.minimum_north_position), float(grid.minimum_east_position)
        high, wide = float(grid.cell_north_size), float(grid.cell_east_size)
        cells = to_numpy_array(files[grid.filename], grid)
        kg_ha = cells / 100.0 if grid.type.value == "2" else np.vectorize(lambda one: code.get(one, 0.0))(cells)
        shapes += [(shapely.box(lon + i * wide, lat + j * high, lon + (i + 1) * wide, lat + (j + 1) * high), rate)
                   for (j, i), rate in np.ndenumerate(kg_ha) if rate > 0.0]
    if fields_deg:
        field = shapely.union_all([shapely.Polygon(rings[0][:, ::-1], [hole[:, ::-1] for hole in rings[1:]])
                                   for rings in fields_deg])
        shapes = [(shape.intersection(field), rate) for shape, rate in shapes]
    west, south, east, north = shapely.total_bounds([shape for shape, _rate in shapes])
    to_m = pyproj.Transformer.from_crs(4326, f"+proj=laea +lat_0={(south + north) / 2} +lon_0={(west + east) / 2} "
                                       "+datum=WGS84", always_xy=True)
    ha = [shapely.transform(shape, lambda at: np.column_stack(to_m.transform(at[:, 0], at[:, 1]))).area / 1e4
          for shape, _rate in shapes]
    return sum(ha), sum(area * rate for area, (_shape, rate) in zip(ha, shapes, strict=True))


def held_against(read: Imported, path: Path, valid: Any) -> tuple[list[str], bool]:
    """What geopandas, isoxml and the public schema say of a map, and whether one of them says otherwise."""
    shares = statistics(read.data)
    mass = sum(share.mass_kg for share in shares)
    said, differs = [by_geopandas(read, path)], False
    found = re.search(r"ha, ([\d.]+) kg", said[0])
    overlap = map_check(read.data).overlap_ha > 0.0
    if found and not overlap:
        differs |= abs(float(found[1]) - mass) > SHARE_OFF * mass + 0.01
    with tempfile.TemporaryDirectory() as place:
        task = Path(place) / "task"
        try:
            write_prescription(read.data, task)
        except PrescriptionError as error:
            return [*said, str(error)], differs
        theirs = by_isoxml(task, read.data.fields_deg)
        if theirs is None:
            said.append("isoxml is not installed")
        else:
            said.append(f"isoxml {theirs[0]:.4f} ha, {theirs[1]:.2f} kg")
            differs |= abs(theirs[1] - mass) > SHARE_OFF * mass + 0.01
        if valid is not None:
            errors = len(list(valid.iter_errors(str(task / "TASKDATA.XML"))))
            said.append(f"{errors} schema errors")
            differs |= errors > 0
    return [*said, "DIFFERS"] if differs else said, differs


def receiver(path: Path) -> tuple[str, str, bool]:
    """What became of a recording, the line, and whether pynmea2 reads another place out of a GGA of ours."""
    import pynmea2
    data = path.read_bytes()
    records, counts = decode("gnss", data)
    theirs = set()
    for line in data.decode("latin-1").splitlines():
        try:
            one = pynmea2.parse(line.strip(), check=True)
            theirs.add((round(one.latitude, 6), round(one.longitude, 6)))
        except (pynmea2.ParseError, AttributeError, ValueError, TypeError):
            continue
    ours = {(round(record["lat_deg"], 6), round(record["lon_deg"], 6)) for record in records}
    rejected = ", ".join(f"{count} {name}" for name, count in sorted(counts.rejected.items())) or "none rejected"
    other = ours - theirs
    line = f"{len(records)} fixes of {counts.accepted} sentences, {rejected}; {len(other)} places other than pynmea2's"
    return ("imported" if records else "refused"), line, bool(other)


def sheet(path: Path) -> list[tuple[str, str, str]]:
    """Each command that could take a table: what, the line, the command."""
    found = []
    for command in (["diagnose"], ["calibrate", "lag"], ["calibrate", "catch"], ["import", "--guess"]):
        with tempfile.TemporaryDirectory() as place:
            more = {"import": ["--mapping", f"{place}/guess.import.yaml"], "calibrate": ["--out", f"{place}/new.yaml"]}
            done = CliRunner().invoke(app, [*command, str(path), *more.get(command[0], [])])
        lines = [line for line in done.output.splitlines() if line.strip() and not line.startswith("note")]
        broken = done.exception is not None and not isinstance(done.exception, SystemExit)
        what = "TRACEBACK" if broken else {0: "imported", 3: "not judged"}.get(done.exit_code, "refused")
        said = lines[-1] if done.exit_code == 2 else lines[0]
        found.append((what, repr(done.exception) if broken else said, " ".join(command)))
    return found


def table_of(counts: dict[str, dict[str, int]]) -> list[str]:
    total: dict[str, int] = defaultdict(int)
    lines = [f"{'kind':24} {'files':>6} " + " ".join(f"{name:>10}" for name in COLUMNS)]
    for kind, found in [*sorted(counts.items()), ("total", total)]:
        lines.append(f"{kind:24} {sum(found[name] for name in COLUMNS[:-1]):6} "
                     + " ".join(f"{found[name]:10}" for name in COLUMNS))
        for name in COLUMNS:
            total[name] += found[name] if kind != "total" else 0
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, default=[SHARED])
    parser.add_argument("--lines", action="store_true", help="What was said of each file.")
    told = parser.parse_args()
    counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    valid, lines = schema(), []

    def count(kind: str, what: str, name: str, said: list[str], differs: bool = False) -> None:
        counts[kind][what] += 1
        counts[kind]["differ"] += differs
        lines.append(f"{what:10} {kind}: {name}: {'; '.join(one for one in said if one)}")
    for folder in told.folders:
        for path in files_in(folder):
            try:
                kind, what, line, read = tried(path)
                said, differs = ([], False) if read is None else held_against(read, path, valid)
            except Exception as error:          # the very thing that is looked for
                kind, what, line, said, differs = path.suffix, "TRACEBACK", repr(error), [], False
            count(kind, what, path.name, [line, *said], differs)
            for what, line, command in sheet(path) if path.suffix.lower() in LOGS else ():
                count(command, what, path.name, [line])
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() in RECORDINGS:
                what, line, differs = receiver(path)
                count("receiver", what, path.name, [line], differs)
    print(*table_of(counts), sep="\n")
    for line in lines if told.lines else [line for line in lines if not line.startswith("imported")]:
        print(line)
    wrong = any(found["TRACEBACK"] or found["differ"] for found in counts.values())
    return int(wrong or not lines)


if __name__ == "__main__":
    sys.exit(main())

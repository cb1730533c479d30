"""Everything tried, a line a kind: how many files, imported, asked, refused with which line; and sums by others.

    python benchmarks/files_tried.py [FOLDER ...] [--lines]

Maps in FOLDER (searched through) are read by `read_prescription`, what is no map by the import of logs. Areas and
kilograms of shapefiles and GeoJSON are held against geopandas in an equal-area projection; every map is written as a
task and held against the public schema by xmlschema (both of the dev extra). Without FOLDER: the shared data.
"""
from __future__ import annotations

import argparse
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

from verdict import exit_code

from control.targets.prescription import statistics
from drivers.files.any_log import open_log
from drivers.files.prescriptions.csv_zones import holds_polygons
from drivers.files.prescriptions.read import read_prescription
from drivers.files.prescriptions.words import Imported, PrescriptionError, RateQuestion
from drivers.files.prescriptions.write import write_prescription

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
MAPS = (".shp", ".geojson", ".json", ".zip")
LOGS = (".csv", ".xlsx", ".parquet")


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
        return kind, "asked", str(error), None
    except (PrescriptionError, OSError) as error:
        return kind, "refused", str(error), None
    shares = statistics(read.data)
    area, mass = sum(s.area_ha for s in shares), sum(s.mass_kg for s in shares)
    return kind, "imported", f"{read.rate_from}, {read.unit}: {area:.4f} ha, {mass:.2f} kg", read


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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, default=[SHARED])
    parser.add_argument("--lines", action="store_true", help="What was said of each file.")
    told = parser.parse_args()
    counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    valid, lines, wrong = schema(), [], 0
    for path in [path for folder in told.folders for path in files_in(folder)]:
        kind, what, line, read = tried(path)
        counts[kind][what] += 1
        more = [] if read is None else [by_geopandas(read, path)]
        if read is not None and valid is not None:
            with tempfile.TemporaryDirectory() as place:
                try:
                    write_prescription(read.data, Path(place) / "task")
                    errors = len(list(valid.iter_errors(str(Path(place) / "task/TASKDATA.XML"))))
                    wrong += errors
                    more.append(f"{errors} schema errors")
                except PrescriptionError as error:
                    more.append(str(error))
        lines.append(f"{what:9} {path.name}: {'; '.join(one for one in (line, *more) if one)}")
    print(f"{'kind':14} {'files':>6} {'imported':>9} {'asked':>6} {'refused':>8}")
    for kind, found in sorted(counts.items()):
        print(f"{kind:14} {sum(found.values()):6} {found['imported']:9} {found['asked']:6} {found['refused']:8}")
    for line in lines if told.lines else [line for line in lines if not line.startswith("imported")]:
        print(line)
    return exit_code({
        f"files found in {', '.join(map(str, told.folders))}": lines,
        "at least one is imported": any(found["imported"] for found in counts.values()),
        f"{wrong} schema errors: none": wrong == 0})


if __name__ == "__main__":
    sys.exit(main())

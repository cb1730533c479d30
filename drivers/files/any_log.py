"""A log of any program, opened as a run log: its own as it is, another's through the import where nothing is unsure."""
from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from control.log_row import COLUMNS
from drivers.files.foreign import our_names
from drivers.files.limits import read_json
from drivers.files.read_log import LogError, RunLog, read_rows
from drivers.files.sheet_text import SUFFIXES as SHEETS
from drivers.files.table import TableError, header_of

FOREIGN = frozenset({".geojson", ".json", ".shp", ".zip", ".xml", ".parquet", ".pq"})
TABLES = frozenset({".csv", ".tsv", ".txt", ".log", ".dat", *SHEETS})
POINTS = (1, 11, 21)            # types of shapes: point, with height, with measure
KNOWN_SHARE = 0.5               # of the columns; fewer are another program's log, which the import reads better


def open_log(path: Path) -> RunLog:
    """Raises LogError, ImportTrouble (the open questions, where the import is not sure of all), OSError."""
    if not is_foreign(path):
        try:
            return read_rows(path)
        except LogError:
            if "time_s" in [name.strip().lower() for name in header_of(path)]:
                raise                       # our own; of another's with names as ours the import knows more
    from drivers.files.imports.convert import convert
    from drivers.files.imports.guess import guess
    from drivers.files.imports.join import joined
    from drivers.files.imports.log_file import write_imported
    from drivers.files.imports.read import read_raw
    from drivers.files.imports.trouble import ImportTrouble
    raw = read_raw(path)
    found = guess(raw)
    if not found.sure:
        raise ImportTrouble(*found.questions(path), f"{path}: not opened: topdress import {path} --guess writes an "
                            "import file in which these lines can be put right")
    imported = joined([convert(raw, found.mapping)], found.mapping.join)
    with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
        place = Path(folder) / "imported.csv"
        write_imported(place, imported, found.mapping, None)
        log = read_rows(place)
    odd = (*(one for part in imported.parts for one in part.findings), *imported.findings)
    return replace(log, path=path, findings=(*odd, *(one for one in log.findings if one not in odd)))


def is_foreign(path: Path) -> bool:
    """Whether the import reads this rather than `read_log`. Raises TableError, OSError."""
    if path.is_dir() or path.suffix.lower() in FOREIGN:
        return True
    names = header_of(path)
    plain = [name.strip().lower() for name in names]
    if "time_s" in plain:
        return False
    ours = our_names(names).names
    known = sum(name in COLUMNS for name in ours)
    return not ({"time_s", "utc"} & set(ours) and known >= KNOWN_SHARE * len(ours) and known > 1)


def holds_points(path: Path) -> bool:
    """Whether a file that might be a map of areas holds places that were worked instead. Raises OSError."""
    from drivers.files.archives import ArchiveError
    kind = path.suffix.lower()
    looks: dict[str, Callable[[Path], bool]] = {".geojson": _points_of_geojson, ".json": _points_of_geojson}
    try:
        return looks.get(kind, _points_of_files)(path)
    except (ArchiveError, TableError, ValueError):
        return False


def _points_of_geojson(path: Path) -> bool:
    root = read_json(path)
    features = root.get("features") if isinstance(root, dict) else None
    shapes = [one.get("geometry") for one in features if isinstance(one, dict)] if isinstance(features, list) else []
    kinds = {str(shape.get("type")) for shape in shapes if isinstance(shape, dict)}
    return "Point" in kinds and not kinds & {"Polygon", "MultiPolygon"}


def _points_of_files(path: Path) -> bool:
    """A task that was worked and prescribes nothing; or shapefiles of which none has areas."""
    from drivers.files.prescriptions.task_files import task_sets, task_tree
    from drivers.files.shape_sets import shape_sets
    tasks = task_sets(path)
    if tasks:
        roots = [task_tree(one) for one in tasks]
        return any(root.find("TSK/TLG") is not None for root in roots) and not any(
            root.find("TSK/TZN") is not None for root in roots)
    heads = [one.part(".shp") or b"" for one in shape_sets(path)]
    kinds = [int.from_bytes(head[32:36], "little") for head in heads]
    return bool(kinds) and all(kind in POINTS for kind in kinds)

"""Which files hold places rather than areas, by a look at what they begin with. Starts light: no polars."""
from __future__ import annotations

from pathlib import Path

from drivers.files.limits import read_json
from drivers.files.sheet_text import SUFFIXES as SHEETS

TABLES = frozenset({".csv", ".tsv", ".txt", ".log", ".dat", *SHEETS})
POINTS = (1, 11, 21)            # types of shapes: point, with height, with measure


def holds_points(path: Path) -> bool:
    """Whether a file that might be a map of areas holds places that were worked instead. Raises OSError."""
    is_json = path.suffix.lower() in (".geojson", ".json") and not path.is_dir()
    try:
        return _points_of_geojson(path) if is_json else _points_of_files(path)
    except ValueError:
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

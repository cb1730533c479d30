"""How is a field of AgOpenGPS read and written?

The field is a folder with Field.txt, Boundary.txt, Headland.txt and TrackLines.txt (before version
6: ABLines.txt). Positions are metres east and north of the start fix, by AgOpenGPS's own series for
the length of a degree. The length of a degree of longitude is that at the position itself. Files of
versions 4 to 6 are supported.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from topdress.control.recordings.finding import Finding
from topdress.control.targets.rate_map import Floats
from topdress.drivers import day_clock
from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.fields.field_data import (
    MAX_HEADLAND_WIDTH_DIFFERENCE_M,
    FieldData,
    FieldError,
    FieldLine,
    calc_headland_width_m,
)

# Modes of a track in TrackLines.txt (AgOpenGPS's TrackMode).
AB_LINE_MODE, CURVE_MODE = 2, 4
# Largest number of points of a list; a field's outline has some thousand points.
MAX_POINT_COUNT = 200_000
# Twice the area of a triangle, m2, below which it is a turning point of a strip.
MIN_TWICE_TRIANGLE_AREA_M2 = 1e-6
# Half length of an AB line, m. Old files hold a position and a heading, and AgOpenGPS extends the
# line by this length to both sides.
AB_HALF_LENGTH_M = 1000.0


class _Plane(NamedTuple):
    """Converts between degrees and metres from the start fix, as AgOpenGPS does."""

    lat_deg: float
    lon_deg: float

    @property
    def latitude_degree_m(self) -> float:
        """Length of a degree of latitude at the start fix, m."""
        lat = math.radians(self.lat_deg)
        return (
            # AgOpenGPS's own series.
            111132.92
            - 559.82 * math.cos(2 * lat)
            + 1.175 * math.cos(4 * lat)
            - 0.0023 * math.cos(6 * lat)
        )

    def to_deg(self, places: Floats) -> Floats:
        """Returns latitude and longitude (n, 2) of positions (n, 2), m east and north."""
        lat = self.lat_deg + places[:, 1] / self.latitude_degree_m
        return np.column_stack((lat, self.lon_deg + places[:, 0] / _calc_longitude_degree_m(lat)))

    def to_m(self, degrees: Floats) -> Floats:
        """Returns positions (n, 2), m east and north, of latitude and longitude (n, 2)."""
        east = (degrees[:, 1] - self.lon_deg) * _calc_longitude_degree_m(degrees[:, 0])
        return np.column_stack((east, (degrees[:, 0] - self.lat_deg) * self.latitude_degree_m))


def _calc_longitude_degree_m(lat_deg: Floats) -> Floats:
    """Returns the length of a degree of longitude at latitudes (n,), m."""
    lat = np.radians(lat_deg)
    return np.asarray(111412.84 * np.cos(lat) - 93.5 * np.cos(3 * lat) + 0.118 * np.cos(5 * lat))


def read_agopengps(folder: Path) -> FieldData:
    """Returns a field of AgOpenGPS.

    Parameters
    ----------
    folder : folder with Field.txt and the other files, in any case of letters.

    Returns
    -------
    outline, holes, lines and headland width in degrees and metres, with findings.

    Raises
    ------
    FieldError : the folder is no field of AgOpenGPS, or a file cannot be read.
    OSError : a file cannot be opened.
    """
    # Windows ignores case, so copied files may have any case.
    files = {one.name.lower(): one for one in folder.iterdir() if one.is_file()}
    if "field.txt" not in files:
        raise FieldError(f"{folder}: no Field.txt: allowed is the folder of a field of AgOpenGPS")
    plane = _read_start_fix(files["field.txt"])
    rings = _read_rings(files["boundary.txt"]) if "boundary.txt" in files else []
    headlands = _read_rings(files["headland.txt"]) if "headland.txt" in files else []
    findings: list[Finding] = []
    lines = _read_guidance_lines(files, plane)
    width = None
    # A headland without points was deleted in AgOpenGPS.
    if rings and headlands and headlands[0][1].size:
        middle, least, most = calc_headland_width_m(rings[0][1], headlands[0][1])
        # A job has one width for its headland, so an uneven headland is refused.
        if most - least <= MAX_HEADLAND_WIDTH_DIFFERENCE_M:
            width = middle
        else:
            findings.append(
                Finding(
                    "headland",
                    f"headland between {least:.1f} and {most:.1f} m wide: not taken, a job "
                    "has one width: say headland_m in it",
                )
            )
    # The first ring is the outline; only inner rings may be driven through.
    driven = [k for k, (through, _) in enumerate(rings) if k and through]
    if driven:
        findings.append(
            Finding(
                "drive_through",
                f"{len(driven)} inner boundary that is driven through: worked like the rest",
            )
        )
    # Worked ground is mentioned, because the user may want to import it too.
    if "sections.txt" in files and len(marked := _parse_triangles(files["sections.txt"])):
        area = float(shapely.union_all(shapely.polygons(marked)).area) / 10_000.0
        findings.append(
            Finding(
                "sections",
                f"{area:.3f} ha are marked as worked in Sections.txt: --done takes them as "
                "ground that is done",
            )
        )
    degrees = [plane.to_deg(ring) for k, (_, ring) in enumerate(rings) if k not in driven]
    return FieldData(
        folder.resolve().name,
        degrees[0] if degrees else None,
        # All further rings are holes that are not worked.
        tuple(degrees[1:]),
        tuple(lines),
        width,
        tuple(findings),
    )


def _read_lines(path: Path) -> list[str]:
    """Returns the lines of a file, stripped, in UTF-8 or UTF-16."""
    data = path.read_bytes()
    # Some editors on Windows save UTF-16 with a byte order mark.
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    return [line.strip() for line in data.decode(encoding, errors="replace").splitlines()]


def _read_start_fix(path: Path) -> _Plane:
    """Returns the plane at the file's start fix. The name in the file is always FieldNew, so the
    folder's name is used instead."""
    lines = _read_lines(path)
    try:
        lat, lon = (float(word) for word in lines[lines.index("StartFix") + 1].split(",")[:2])
    except (ValueError, IndexError):
        raise FieldError(
            f"{path}: no StartFix with latitude and longitude: allowed is a field of "
            "version 4 or later"
        ) from None
    # At a pole a degree of longitude has no length.
    if not (abs(lat) < 90.0 and abs(lon) <= 180.0):
        raise FieldError(f"{path}: StartFix {lat:g}, {lon:g}: allowed are degrees")
    return _Plane(lat, lon)


def _read_rings(path: Path) -> list[tuple[bool, Floats]]:
    """Returns each ring of Boundary.txt or Headland.txt: whether it may be driven through, and its
    positions (n, 2), m."""
    # Lines beginning with $ are headers of the file.
    rest = iter([line for line in _read_lines(path) if line and not line.startswith("$")])
    found, through = [], False
    for line in rest:
        if line in ("True", "False"):
            # Some versions write two True/False lines before a ring, which may be driven through if
            # either is True.
            through = through or line == "True"
            continue
        found.append((through, _parse_points(path, rest, _parse_point_count(path, line))))
        through = False
    return [
        (driven, ring)
        for driven, ring in found
        # A ring needs three corners; an empty headland is a valid file.
        if len(ring) >= 3 or path.name.lower() == "headland.txt"
    ]


def _parse_point_count(path: Path, text: str) -> int:
    if not text.isdigit() or int(text) > MAX_POINT_COUNT:
        raise FieldError(
            f"{path}: {text[:40]}: allowed is a number of points, up to {MAX_POINT_COUNT}"
        )
    return int(text)


def _parse_points(path: Path, rest: Iterator[str], count: int) -> Floats:
    """Returns the next positions (count, 2), m east and north."""
    rows = []
    for _ in range(count):
        text = next(rest, "")
        try:
            east, north = (float(word) for word in text.split(",")[:2])
        except ValueError:
            raise FieldError(
                f"{path}: {text[:40]!r}: allowed is a place, east and north with a comma "
                "between (is the "
                "file cut off?)"
            ) from None
        # A damaged file may contain "nan", which no later check would detect.
        if not (math.isfinite(east) and math.isfinite(north)):
            raise FieldError(f"{path}: {text[:40]!r}: allowed are finite numbers")
        rows.append((east, north))
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def _read_guidance_lines(files: dict[str, Path], plane: _Plane) -> list[FieldLine]:
    """Returns the guidance lines, from TrackLines.txt or the older ABLines.txt."""
    if "tracklines.txt" in files:
        return _read_track_lines(files["tracklines.txt"], plane)
    return _read_ab_lines(files["ablines.txt"], plane) if "ablines.txt" in files else []


def _read_track_lines(path: Path, plane: _Plane) -> list[FieldLine]:
    rest = iter(_read_lines(path)[1:])
    found = []
    for title in rest:
        if not title:
            continue
        # The heading (radians) is skipped, because it follows from the ends.
        next(rest, "")
        ends = _parse_points(path, rest, 2)
        # The three lines are offset, mode and visibility.
        _, mode, _ = (next(rest, "") for _ in range(3))
        curve = _parse_points(path, rest, _parse_point_count(path, next(rest, "")))
        # An AB line is stored with a curve of zero points.
        places = curve if mode not in (str(AB_LINE_MODE), "") and len(curve) > 1 else ends
        found.append(FieldLine(title, plane.to_deg(places)))
    return found


def _read_ab_lines(path: Path, plane: _Plane) -> list[FieldLine]:
    """Returns the lines of ABLines.txt, each `name,heading in degrees,east,north`."""
    found = []
    for text in _read_lines(path):
        words = text.split(",")
        # Other lines are headers of newer versions.
        if len(words) != 4:
            continue
        try:
            heading, east, north = (float(word) for word in words[1:])
        except ValueError:
            raise FieldError(f"{path}: {text[:60]!r}: allowed name,heading,east,north") from None
        way = AB_HALF_LENGTH_M * np.array(
            [math.sin(math.radians(heading)), math.cos(math.radians(heading))]
        )
        middle = np.array([east, north])
        found.append(FieldLine(words[0], plane.to_deg(np.array([middle - way, middle + way]))))
    return found


def read_worked_triangles(folder: Path) -> Floats:
    """Returns the ground that Sections.txt marks as worked.

    The file holds strips of triangles: number of rows, colour, then left and right edge in turn, m.

    Returns
    -------
    triangles (n, 3, 2) in latitude and longitude; they may overlap.

    Raises
    ------
    FieldError : the folder is no field of AgOpenGPS, or a file cannot be read.
    OSError : a file cannot be opened.
    """
    files = {one.name.lower(): one for one in folder.iterdir() if one.is_file()}
    missing = [name for name in ("Field.txt", "Sections.txt") if name.lower() not in files]
    if missing:
        raise FieldError(
            f"{folder}: no {missing[0]}: allowed is the folder of a field of AgOpenGPS"
        )
    plane = _read_start_fix(files["field.txt"])
    triangles = _parse_triangles(files["sections.txt"])
    return plane.to_deg(triangles.reshape(-1, 2)).reshape(-1, 3, 2)


def _parse_triangles(path: Path) -> Floats:
    """Returns triangles (n, 3, 2), m, without triangles of zero area."""
    rest = iter([line for line in _read_lines(path) if line])
    strips = [np.zeros((0, 3, 2))]
    for line in rest:
        # The first row of a strip is its colour.
        rows = _parse_points(path, rest, _parse_point_count(path, line))[1:]
        if len(rows) > 2:
            # Each further corner makes a triangle with the two before it.
            strips.append(np.stack((rows[:-2], rows[1:-1], rows[2:]), axis=1))
    all_of = np.concatenate(strips)
    one, other = all_of[:, 1] - all_of[:, 0], all_of[:, 2] - all_of[:, 0]
    return all_of[
        np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) > MIN_TWICE_TRIANGLE_AREA_M2
    ]


def write_agopengps(data: FieldData, folder: Path) -> None:
    """Writes the files that AgOpenGPS needs to open a field. Raises OSError."""
    origin = data.plane()
    plane = _Plane(origin.lat_deg, origin.lon_deg)
    # AgOpenGPS writes its own dates in this format.
    today = f"{day_clock.read_local_now():%Y-%B-%d %I:%M:%S %p}"
    files = {
        "Field.txt": [
            today,
            "$FieldDir",
            folder.name,
            "$Offsets",
            "0,0",
            "Convergence",
            "0",
            "StartFix",
            f"{plane.lat_deg:.7f},{plane.lon_deg:.7f}",
        ],
        "Boundary.txt": ["$Boundary"],
        "TrackLines.txt": ["$TrackLines"],
        "Headland.txt": ["$Headland"],
        # No ground is worked yet, but AgOpenGPS expects the file.
        "Sections.txt": [],
        "Contour.txt": ["$Contour"],
        "Flags.txt": ["$Flags", "0"],
    }
    for ring in () if data.outline_deg is None else (data.outline_deg, *data.holes_deg):
        places = plane.to_m(ring)
        # Inner boundaries are written as areas that must not be driven through.
        files["Boundary.txt"] += ["False", str(len(places)), *_format_places(places)]
    if data.outline_deg is not None and data.headland_m:
        inner = data.boundary(origin)
        assert inner is not None
        # A headland that fills the whole field leaves no inner ring.
        shrunk = inner.inset_margin(data.headland_m).rings
        places = (
            np.array([origin.convert_to_deg(*place) for place in shrunk[0]])
            if shrunk
            else np.zeros((0, 2))
        )
        headland = plane.to_m(places)
        files["Headland.txt"] += [str(len(headland)), *_format_places(headland)]
    for number, line in enumerate(data.lines, start=1):
        places = plane.to_m(line.places_deg)
        curve = len(places) > 2
        way = places[-1] - places[0]
        files["TrackLines.txt"] += [
            line.title or f"AB {number}",
            f"{math.atan2(way[0], way[1]) % (2 * math.pi):.8f}",
            _format_place(places[0]),
            _format_place(places[-1]),
            "0",
            str(CURVE_MODE if curve else AB_LINE_MODE),
            "True",
            *([str(len(places)), *_format_places(places)] if curve else ["0"]),
        ]
    folder.mkdir(parents=True, exist_ok=True)
    for name, lines in files.items():
        # AgOpenGPS runs on Windows and writes these line ends.
        write_atomically(folder / name, "".join(f"{line}\r\n" for line in lines))


def _format_places(places: Floats) -> list[str]:
    """Returns a line for each position, with the heading to the next position, radians, as
    AgOpenGPS stores it."""
    # The last position points to the first, because a boundary is closed.
    way = np.roll(places, -1, axis=0) - places
    headings = np.arctan2(way[:, 0], way[:, 1]) % (2 * math.pi)
    return [
        f"{_format_place(place)},{heading:.5f}"
        for place, heading in zip(places, headings, strict=True)
    ]


def _format_place(place: Floats) -> str:
    """Returns a position as text, m, with millimetres."""
    return f"{place[0]:.3f},{place[1]:.3f}"

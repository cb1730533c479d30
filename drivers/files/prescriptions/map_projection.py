"""How are metres of a transverse Mercator projection (UTM, Gauss-Krueger) converted to degrees, and
how is a projection read from a `.prj` file?

The conversion is Krueger's series in the third flattening up to its fifth power. It is exact to a
tenth of a millimetre within 10 degrees of the central meridian (Karney 2011, "Transverse Mercator
with an accuracy of a few nanometers", eq 10-12, 35, 36).
"""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from topdress.control.targets.rate_map import Floats

# Spheroids WGS84 and GRS80; datums on them differ by less than 2 m.
SEMI_MAJOR_M = 6_378_137.0
INVERSE_FLATTENING = (298.2572, 298.2573)
# A quoted text, a word, a number or a bracket.
_WKT_TOKEN = re.compile(
    r'\s*(?:"([^"]*)"|([A-Za-z_][A-Za-z_0-9]*)|([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)|([\[\](),]))'
)


@dataclass(frozen=True)
class TransverseMercator:
    """Describes a projection with the parameters of a `.prj`; lengths of the file times `unit_m`
    are metres."""

    name: str
    lon0_deg: float
    lat0_deg: float = 0.0
    scale: float = 1.0
    false_east: float = 0.0
    false_north: float = 0.0
    unit_m: float = 1.0
    flattening: float = 1.0 / 298.257223563
    how = ""

    def to_deg(self, east: Floats, north: Floats) -> tuple[Floats, Floats]:
        """Returns latitude and longitude (n,) of positions in the file's own unit."""
        # The third flattening makes Krueger's series converge fastest.
        n = self.flattening / (2.0 - self.flattening)
        radius = SEMI_MAJOR_M / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0) * self.scale
        # Northing is counted from the latitude of origin.
        xi = (np.asarray(north) - self.false_north) * self.unit_m / radius + self._calc_origin_xi(n)
        eta = (np.asarray(east) - self.false_east) * self.unit_m / radius
        # Both series use the unchanged coordinates, so the sums need copies.
        sphere_xi, sphere_eta = xi.copy(), eta.copy()
        for j, factor in enumerate(_calc_beta_series(n), start=1):
            sphere_xi -= factor * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
            sphere_eta -= factor * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
        conformal = np.arcsin(np.sin(sphere_xi) / np.cosh(sphere_eta))
        lon = self.lon0_deg + np.degrees(np.arctan2(np.sinh(sphere_eta), np.cos(sphere_xi)))
        # Longitudes stay within -180 to 180 degrees.
        return np.degrees(self._calc_geodetic_rad(conformal)), (lon + 180.0) % 360.0 - 180.0

    def _calc_geodetic_rad(self, conformal: Floats) -> Floats:
        """Returns the latitude of a conformal latitude, radians. Each round adds two and a half
        digits."""
        # The first eccentricity follows from the flattening.
        e = math.sqrt(self.flattening * (2.0 - self.flattening))
        isometric = np.arctanh(np.sin(conformal))
        lat = conformal
        # Seven rounds exhaust double precision.
        for _ in range(7):
            lat = np.arcsin(np.tanh(isometric + e * np.arctanh(e * np.sin(lat))))
        return np.asarray(lat, dtype=np.float64)

    def _calc_origin_xi(self, n: float) -> float:
        """Returns the series' xi at the latitude of origin on the central meridian."""
        lat = math.radians(self.lat0_deg)
        e = math.sqrt(self.flattening * (2.0 - self.flattening))
        sine = math.tanh(math.atanh(math.sin(lat)) - e * math.atanh(e * math.sin(lat)))
        conformal = math.asin(sine)
        return conformal + sum(
            factor * math.sin(2 * j * conformal)
            for j, factor in enumerate(_calc_alpha_series(n), start=1)
        )


class NationalGrid(NamedTuple):
    """Holds coordinates that PROJ knows. `how` is the accuracy of their degrees, as text."""

    name: str
    how: str
    transformer: Any

    def to_deg(self, east: Floats, north: Floats) -> tuple[Floats, Floats]:
        """Returns latitude and longitude (n,) of positions in the file's own unit."""
        lon, lat = self.transformer.transform(east, north)
        return lat, lon


Projection = TransverseMercator | NationalGrid


def find_national_grid(text: str, places: Floats) -> NationalGrid | None:
    """Returns the coordinate system of a well-known text by the EPSG register.

    The function needs pyproj, and uses the most accurate transformation to WGS84 for the area of
    the positions. All parameters come from the register.

    Parameters
    ----------
    text : well-known text of a `.prj`.
    places : (n, 2) positions in the file's own unit.

    Returns
    -------
    None without pyproj, or for a text that the register does not know.
    """
    # pyproj belongs to an extra, and without it only UTM and similar systems are read.
    try:
        from pyproj import CRS, Transformer
        from pyproj.exceptions import ProjError
        from pyproj.transformer import AreaOfInterest, TransformerGroup
    except ImportError:
        return None
    try:
        # pyproj's own default confidence, %.
        code = CRS.from_wkt(text).to_epsg(min_confidence=70)
        # Without positions no area of use can be verified.
        if code is None or not len(places):
            return None
        crs = CRS.from_epsg(code)
        # This transformation is accurate to 1 km, which is sufficient for the choice of the area.
        roughly = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True).transform(*places.T)
        (west, south), (east, north) = np.min(roughly, axis=1), np.max(roughly, axis=1)
        # PROJ warns that a better transformation needs a file; its accuracy is reported instead.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            ways = TransformerGroup(
                crs,
                4326,
                always_xy=True,
                allow_ballpark=False,
                area_of_interest=AreaOfInterest(west, south, east, north),
            ).transformers
    except ProjError:
        return None
    # Only transformations whose area covers all positions are accurate there.
    here = [
        one
        for one in ways
        if (area := one.area_of_use) is None
        or (area.west <= west and area.south <= south and east <= area.east and north <= area.north)
    ]
    if not here:
        return None
    return NationalGrid(
        # A negative accuracy means that PROJ does not know it.
        crs.name,
        f", right to {here[0].accuracy:g} m" if here[0].accuracy >= 0.0 else "",
        here[0],
    )


def _calc_alpha_series(n: float) -> tuple[float, ...]:
    return (
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180 - 127 * n**5 / 288,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440 + 281 * n**5 / 630,
        61 * n**3 / 240 - 103 * n**4 / 140 + 15061 * n**5 / 26880,
        49561 * n**4 / 161280 - 179 * n**5 / 168,
        34729 * n**5 / 80640,
    )


def _calc_beta_series(n: float) -> tuple[float, ...]:
    return (
        n / 2 - 2 * n**2 / 3 + 37 * n**3 / 96 - n**4 / 360 - 81 * n**5 / 512,
        n**2 / 48 + n**3 / 15 - 437 * n**4 / 1440 + 46 * n**5 / 105,
        17 * n**3 / 480 - 37 * n**4 / 840 - 209 * n**5 / 4480,
        4397 * n**4 / 161280 - 11 * n**5 / 504,
        4583 * n**5 / 161280,
    )


@dataclass(frozen=True)
class _Node:
    """Holds a node of a well-known text: `KEY["name", 1.0, CHILD[...]]`."""

    key: str
    name: str = ""
    numbers: tuple[float, ...] = ()
    children: tuple[_Node, ...] = field(default=())

    def find_child(self, key: str) -> _Node | None:
        """Returns the first child of a key; None for a missing child."""
        return next((child for child in self.children if child.key == key), None)


def parse_projection(text: str) -> TransverseMercator | None:
    """Returns the projection that a `.prj` describes; None for degrees on WGS84 or an equivalent
    datum.

    Raises
    ------
    ValueError : the coordinates cannot be used; the message names them and the reason.
    """
    try:
        node = _parse_node([match.groups() for match in _WKT_TOKEN.finditer(text)], 0)[0]
    # Any damage of the text has the same consequence for the user.
    except (ValueError, IndexError):
        raise ValueError("unknown coordinates: not well-known text") from None
    if node.key == "GEOGCS":
        _check_spheroid(node, node.name)
        return None
    if node.key != "PROJCS":
        raise ValueError(f"{node.name or 'unknown coordinates'}: {node.key} is not understood")
    geographic, kind, unit = (
        node.find_child("GEOGCS"),
        node.find_child("PROJECTION"),
        node.find_child("UNIT"),
    )
    if geographic is None or kind is None:
        raise ValueError(f"{node.name}: without GEOGCS and PROJECTION")
    flattening = _check_spheroid(geographic, node.name)
    # Other projections are left to the EPSG register.
    if kind.name.lower() not in ("transverse_mercator", "gauss_kruger"):
        raise ValueError(f"{node.name}: projection {kind.name}")
    values = {
        child.name.lower(): child.numbers[0]
        for child in node.children
        if child.key == "PARAMETER" and child.numbers
    }
    # A default meridian would place the map on another continent.
    if "central_meridian" not in values:
        raise ValueError(f"{node.name}: without a central meridian")
    return TransverseMercator(
        node.name,
        values["central_meridian"],
        values.get("latitude_of_origin", 0.0),
        values.get("scale_factor", 1.0),
        values.get("false_easting", 0.0),
        values.get("false_northing", 0.0),
        unit.numbers[0] if unit is not None and unit.numbers else 1.0,
        flattening,
    )


def _check_spheroid(geographic: _Node, name: str) -> float:
    """Returns the spheroid's flattening. Raises ValueError where the datum may differ from
    WGS84."""
    datum = geographic.find_child("DATUM")
    spheroid = None if datum is None else datum.find_child("SPHEROID")
    if datum is None or spheroid is None or len(spheroid.numbers) < 2:
        raise ValueError(f"{name}: without a datum and its spheroid")
    axis, inverse = spheroid.numbers[:2]
    low, high = INVERSE_FLATTENING
    # Half a metre of the axis is far below the accuracy of a map.
    if abs(axis - SEMI_MAJOR_M) > 0.5 or not low <= inverse <= high:
        raise ValueError(
            f"{name}: datum {datum.name} on spheroid {spheroid.name} may lie 100 m off WGS84"
        )
    return 1.0 / inverse


def _parse_node(tokens: list[tuple[str | None, ...]], at: int) -> tuple[_Node, int]:
    """Returns the node at a token, and the position after it."""
    key = tokens[at][1]
    if key is None or tokens[at + 1][3] not in ("[", "("):
        raise ValueError("no node")
    at += 2
    name = ""
    numbers: list[float] = []
    children: list[_Node] = []
    while tokens[at][3] not in ("]", ")"):
        quoted, word, number, _ = tokens[at]
        if word is not None and tokens[at + 1][3] in ("[", "("):
            child, at = _parse_node(tokens, at)
            children.append(child)
            continue
        if quoted is not None and not name:
            name = quoted
        elif number is not None:
            numbers.append(float(number))
        at += 1
    return _Node(key.upper(), name, tuple(numbers), tuple(children)), at + 1

"""Why a file is not taken as a prescription, in the language of the screen. Readers say it in English, for a terminal
and for scripts; what an operator meets in the cab is said again here."""
from __future__ import annotations

import contextlib
import re
from pathlib import Path

from console.locale import N_, _
from drivers.files.what_it_is import KINDS, TABLES, what_is

MAP_KINDS = (*TABLES, "geotiff", "gpkg", "kml", "kmz")
_KINDS = {
    "picture": N_("this is a picture"), "pdf": N_("this is a PDF document"), "html": N_("this is a web page"),
    "sqlite": N_("this is an SQLite database"), "gpx": N_("this is a GPX track"),
    "xml": N_("this is an XML file that is no task file"), "fgb": N_("this is a FlatGeobuf file"),
    "las": N_("this is a LAS point cloud"), "gzip": N_("this is a gzip file"), "7z": N_("this is a 7z archive"),
    "rar": N_("this is a RAR archive"), "office": N_("this is a text document"),
    "shp part": N_("this is a part of a shapefile"), "nmea": N_("this is a receiver's capture (NMEA)"),
    "capture": N_("this is a capture of the console"), "config": N_("this is a configuration file of topdress"),
    "aog": N_("this is a field of AgOpenGPS"), "empty": N_("this is an empty file"),
    "binary": N_("this is no text and no known format"),
}
_NUMBER = r"(-?[\d.]+)"
# What a reader says, and the same as a text of the screen with its values as {a} to {d}.
_REASONS = tuple((re.compile(pattern), text) for pattern, text in (
    (rf"latitude and longitude look swapped: latitudes up to {_NUMBER}, longitudes up to {_NUMBER}: allowed are .*",
     N_("latitude and longitude look swapped: latitudes up to {a}, longitudes up to {b}: allowed are latitudes to 90")),
    (rf"coordinates up to {_NUMBER}, {_NUMBER}: allowed are degrees \(WGS84\).*",
     N_("coordinates up to {a}, {b}: allowed are degrees (WGS84)")),
    (r"rate column not chosen: allowed a column of numbers \(columns: (.*)\)",
     N_("rate column not chosen: choose one of {a}")),
    (r"no column of polygons \(WKT\): allowed is one.*", N_("no column of polygons (WKT) is in it")),
    (r"row (\d+): (.+) (\S+): allowed is a number", N_("row {a}: {b} {c}: allowed is a number")),
    (rf"row (\d+): (.+): rate {_NUMBER} kg/ha: allowed 0 to {_NUMBER}.*",
     N_("row {a}: {b} {c} kg/ha: allowed is 0 to {d} kg/ha")),
    (r"columns (.+): allowed are latitude, longitude and a rate .*",
     N_("columns {a}: neither places with a rate nor polygons (WKT) are in it")),
    (rf"(.*)rate {_NUMBER} kg/ha: allowed 0 to {_NUMBER}.*", N_("{a}rate {b} kg/ha: allowed is 0 to {c} kg/ha")),
    (r"column (.+): empty everywhere: allowed is a number", N_("column {a} is empty everywhere")),
    (r"not there: allowed is .*", N_("the file is not there")),
    (r"no cell with a value", N_("no cell has a value")),
    (r"this is a GeoTIFF, a raster: install the extra raster: .*",
     N_("this is a GeoTIFF: the extra raster is missing")),
    (r"type (.+): allowed (?:is )?FeatureCollection.*", N_("type {a}: allowed is FeatureCollection")),
))


def in_words(reason: str) -> str:
    """A reader's reason in the language of the screen; one that is not known here as it is."""
    for pattern, text in _REASONS:
        found = pattern.fullmatch(reason)
        if found:
            return _(text).format(**dict(zip("abcd", found.groups(), strict=False)))
    return reason


def refused(path: Path, why: str, no_map: bool) -> str:
    """Why a file is not taken: first of all, whether it is a map at all. no_map: its reader found that it is none."""
    with contextlib.suppress(OSError):
        kind = what_is(path)
        if kind.id not in MAP_KINDS:
            said = _(_KINDS[kind.id]) if kind.id in _KINDS else f"this is {KINDS[kind.id].words}"
            return _("not a prescription map: {why}").format(why=said)
    why = in_words(why.removeprefix("no prescription: "))
    return _("not a prescription map: {why}").format(why=why) if no_map else why

"""Why is a file refused as a prescription? The answer is in the language of the screen. A reader's
refusal has place and reason as data; its one line in English is for terminals and scripts.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

from topdress.console.locale import N_, _
from topdress.drivers.files.file_sniffer import (
    FILE_KINDS,
    sniff_file_kind,
)
from topdress.drivers.files.formats.registry import list_kinds
from topdress.drivers.files.prescriptions.map_choices import NotAMapError
from topdress.drivers.plain_text import Reason, RefusedInput

MAP_KINDS = list_kinds("read_map", "read_table")
_KIND_REASONS = {
    "picture": N_("this is a picture"),
    "pdf": N_("this is a PDF document"),
    "html": N_("this is a web page"),
    "sqlite": N_("this is an SQLite database"),
    "gpx": N_("this is a GPX track"),
    "xml": N_("this is an XML file that is no task file"),
    "fgb": N_("this is a FlatGeobuf file"),
    "las": N_("this is a LAS point cloud"),
    "gzip": N_("this is a gzip file"),
    "7z": N_("this is a 7z archive"),
    "rar": N_("this is a RAR archive"),
    "office": N_("this is a text document"),
    "shp part": N_("this is a part of a shapefile"),
    "nmea": N_("this is a receiver's capture (NMEA)"),
    "capture": N_("this is a capture of the console"),
    "config": N_("this is a configuration file of topdress"),
    "aog": N_("this is a field of AgOpenGPS"),
    "empty": N_("this is an empty file"),
    "binary": N_("this is no text and no known format"),
}


def translate_reason(reason: Reason) -> str:
    """Returns the reason in the language of the screen, with its values."""
    values = {
        name: translate_reason(value) if isinstance(value, Reason) else value
        for name, value in reason.values.items()
    }
    return _(reason.text).format(**values)


def describe_refusal(error: RefusedInput, path: Path) -> str:
    """Returns the place in the file at `path`, and the reason; for several files (a zip, a
    shapefile) also the name of the file."""
    other = [Path(error.where.file).name] if error.where.file not in ("", str(path)) else []
    return ": ".join([*other, *map(translate_reason, (*error.where.inside, error.reason))])


def describe_map_refusal(path: Path, error: RefusedInput) -> str:
    """Returns the reason why a file is refused, beginning with whether it is a map at all."""
    with contextlib.suppress(OSError):
        kind = sniff_file_kind(path)
        if kind.id not in MAP_KINDS:
            said = (
                _(_KIND_REASONS[kind.id])
                if kind.id in _KIND_REASONS
                else f"this is {FILE_KINDS[kind.id].words}"
            )
            return _("not a prescription map: {why}").format(why=said)
    why = describe_refusal(error, path)
    return (
        _("not a prescription map: {why}").format(why=why)
        if isinstance(error, NotAMapError)
        else why
    )

"""Which format has a file? Formats are modules of this folder, and plug-ins of other packages."""

from __future__ import annotations

from functools import cache
from itertools import chain
from pathlib import Path

from topdress.drivers.files import formats
from topdress.drivers.files.formats.file_format import FileFormat, defer
from topdress.drivers.plugins import has_format_plugin, list_declared

# Reads files by the plug-in that has their suffix.
PLUGIN_FORMAT = FileFormat(
    id="plugin",
    words="a file of a plug-in",
    title="plug-ins",
    endings=(),
    rank=99,
    read_map=defer("prescriptions.shapes", "read_map_layers"),
    read_layers=defer("shape_layers", "read_plugin_layers"),
)


@cache
def list_formats() -> tuple[FileFormat, ...]:
    """Returns the built-in formats in the order of lists."""
    found = chain.from_iterable(list_declared(formats, "FORMATS"))
    return tuple(sorted(found, key=lambda one: one.rank))


def list_able(*functions: str) -> tuple[FileFormat, ...]:
    """Returns the formats that have any of these functions, such as `read_map`."""
    return tuple(one for one in list_formats() if one.has_any(*functions))


def list_kinds(*functions: str) -> tuple[str, ...]:
    """Returns the kinds of files that are read by any of these functions, with zips and folders
    where a format is read from them."""
    able = list_able(*functions)
    packed = ("zip", "folder") if any(one.is_packed for one in able) else ()
    return (*(one.id for one in able), *packed)


def find_format(path: Path, function: str) -> FileFormat | None:
    """Returns the format that reads a file by its suffix, a plug-in's last; None for a folder, an
    unknown suffix and a format without the function."""
    if path.is_dir():
        return None
    suffix = path.suffix.lower()
    built_in = (one for one in list_formats() if suffix in one.endings)
    found = next(built_in, PLUGIN_FORMAT if has_format_plugin(suffix) else None)
    return found if found is not None and found.has_any(function) else None


def find_writer(path: Path, function: str) -> FileFormat | None:
    """Returns the format that writes to a name; None for an unknown suffix."""
    suffix = path.suffix.lower()
    return next((one for one in list_able(function) if suffix in one.written_endings), None)


def list_endings(function: str) -> tuple[str, ...]:
    """Returns the suffixes of outputs by the function that writes them; "" is a folder."""
    return tuple(ending for one in list_able(function) for ending in one.written_endings)


def describe_endings(function: str) -> str:
    """Returns the suffixes of outputs, for a help text or a refusal."""
    endings = list_endings(function)
    return ", ".join(filter(None, endings)) + (" or a folder" if "" in endings else "")


def describe_able(*functions: str) -> str:
    """Returns the names of the formats that have any of these functions."""
    return ", ".join(one.title for one in list_able(*functions))

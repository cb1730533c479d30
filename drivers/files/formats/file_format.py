"""What does a format of files state about itself? Every command, page and list takes it from here.

A format is a `FileFormat` in `FORMATS` of a module of this folder. The functions that it has decide
where it is offered. Every command imports this folder, so libraries are imported inside of
functions, and `defer` names a function elsewhere.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from topdress.drivers.files.limits import DAMAGED_ZIP, OTHER_FILES_LIMIT, Limit

if TYPE_CHECKING:
    from topdress.control.targets.prescription import MapData
    from topdress.drivers.files.exports.as_applied import AsApplied
    from topdress.drivers.files.fields.field_data import FieldData
    from topdress.drivers.files.imports.mapping import Source, SourceKind
    from topdress.drivers.files.imports.raw_table import RawTable
    from topdress.drivers.files.prescriptions.map_choices import ImportedMap, RateChoice
    from topdress.drivers.files.shape_layers import Layer

# The first element of an XML file.
_ROOT_TAG = re.compile(rb"<(?:\w+:)?([A-Za-z_][\w.-]*)[\s>/]")
# Commands that read a format, and its functions of which they need any.
_READING_COMMANDS = {
    "map": ("read_map",),
    "import": ("read_table",),
    "field": ("read_layers", "read_field"),
}


@dataclass(frozen=True, kw_only=True)
class FileFormat:
    """Defines a format of files. Without a function it is not offered where that is needed.

    Parameters
    ----------
    id : name of the kind of file.
    words, title : the kind of file in a refusal; the format in lists.
    endings : suffixes in small letters, the usual first.
    rank : place in lists.
    written : suffixes of outputs, "" for a folder; None means `endings`.
    writing_extra : the extra that writing needs.
    keeps_fallbacks : whether a prescription keeps its fallbacks and field.
    is_packed : whether zips and folders that hold such files are read too.
    is_table : whether the file has rows and columns, and so may be a run log or bench table.
    limit : largest file.
    source_kind : name in import files.
    more_commands, part_read : further commands that read the format, and what they read of it.
    is_content : whether a file, by its path and first bytes, has the format.
    is_map_likely : whether a list of maps shows a file with such a suffix.
    read_map, read_layers, read_field, read_table : readers of a prescription, of shapes for fields
    and done ground, of a field with more than shapes, and of a log. They raise RefusedInput,
    OSError.
    write_map, write_field, write_export : writers of a prescription, a field, applied rates (True:
    as ground). They raise ValueError, OSError.
    make_example : writes an example where neither `write_map` nor `write_field` is there.
    """

    id: str
    words: str
    title: str
    endings: tuple[str, ...]
    rank: int
    written: tuple[str, ...] | None = None
    writing_extra: str = ""
    keeps_fallbacks: bool = False
    is_packed: bool = False
    is_table: bool = False
    limit: Limit = OTHER_FILES_LIMIT
    source_kind: SourceKind | None = None
    more_commands: tuple[str, ...] = ()
    part_read: str = "it"
    is_content: Callable[[Path, bytes], bool] = lambda path, head: False
    is_map_likely: Callable[[Path], bool] = lambda path: True
    read_map: Callable[[Path, RateChoice], ImportedMap] | None = None
    read_layers: Callable[[Path], list[Layer]] | None = None
    read_field: Callable[[Path], FieldData] | None = None
    read_table: Callable[[Path, Source], RawTable] | None = None
    write_map: Callable[[MapData, Path], None] | None = None
    write_field: Callable[[FieldData, Path], None] | None = None
    write_export: Callable[[AsApplied, Path, bool], None] | None = None
    make_example: Callable[[Path], object] | None = None

    @property
    def written_endings(self) -> tuple[str, ...]:
        """Suffixes of outputs in this format."""
        return self.endings if self.written is None else self.written

    def has_any(self, *functions: str) -> bool:
        """Returns whether the format has any of these functions, such as `read_map`."""
        return any(getattr(self, name) for name in functions)

    @property
    def advice(self) -> str:
        """The commands that read the format, for a refusal by another command."""
        able = [name for name, some in _READING_COMMANDS.items() if self.has_any(*some)]
        *first, last = [*able, *self.more_commands]
        names = f"{', '.join(first)} and {last} read" if first else f"{last} reads"
        return f"topdress {names} {self.part_read}"


def defer(module: str, name: str) -> Callable[..., Any]:
    """Returns a function of `drivers.files` whose module is imported at its first call."""
    return lambda *values: getattr(import_module(f"topdress.drivers.files.{module}"), name)(*values)


def find_root_tag(head: bytes) -> str:
    """Returns the name of an XML file's first element in small letters; empty for another file."""
    begin = head.lstrip(b"\xef\xbb\xbf \r\n\t")
    root = _ROOT_TAG.search(re.sub(rb"<[?!].*?>", b"", begin, flags=re.DOTALL))
    return root[1].decode("ascii", "ignore").lower() if root and begin.startswith(b"<") else ""


def list_zip_names(path: Path, head: bytes) -> list[PurePosixPath]:
    """Returns the names in a zip in small letters; none for another or a damaged file."""
    if not head.startswith(b"PK"):
        return []
    try:
        with zipfile.ZipFile(path) as archive:
            return [PurePosixPath(name.lower()) for name in archive.namelist()]
    except DAMAGED_ZIP:
        return []

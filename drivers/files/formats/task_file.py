"""How is an ISO 11783-10 task file known, read and written? Folders and zips are read alike."""

from __future__ import annotations

from topdress.drivers.files.formats.file_format import FileFormat, defer, find_root_tag
from topdress.drivers.files.limits import XML_LIMIT

FORMATS = (
    FileFormat(
        id="task",
        words="an ISOXML task file",
        title="ISO 11783-10",
        endings=(".xml",),
        rank=50,
        is_packed=True,
        written=(".zip", ".xml", ""),
        keeps_fallbacks=True,
        limit=XML_LIMIT,
        source_kind="isoxml",
        more_commands=("check",),
        is_content=lambda path, head: find_root_tag(head) == "iso11783_taskdata",
        # A list of maps shows the folder of a task.
        is_map_likely=lambda path: False,
        read_map=defer("prescriptions.map_reader", "read_packed_map"),
        read_layers=defer("fields.task_fields", "read_task_layers"),
        read_table=defer("imports.task_log", "read_task_log"),
        write_map=defer("prescriptions.map_writer", "write_map_task"),
        write_export=defer("exports.isoxml", "write_isoxml_task"),
    ),
)

"""How is a field of AgOpenGPS, a folder, known, read and written?"""

from __future__ import annotations

from topdress.drivers.files.formats.file_format import FileFormat, defer

FORMATS = (
    FileFormat(
        id="aog",
        words="a field of AgOpenGPS",
        title="AgOpenGPS",
        endings=(),
        rank=80,
        written=("",),
        read_field=defer("fields.agopengps", "read_agopengps"),
        write_field=defer("fields.agopengps", "write_agopengps"),
    ),
)

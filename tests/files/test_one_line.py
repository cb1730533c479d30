"""What a refusal quotes of a file may hold ends of lines of every kind: it stays one line, and nothing else is raised.
"""
from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.files.bench_table import read_bench_table
from drivers.files.config_error import ConfigError
from drivers.files.prescriptions.for_job import read_plants
from drivers.files.prescriptions.read import read_prescription
from drivers.files.read_log import read_log
from drivers.files.setup import by_kind
from drivers.plain_text import one_line

ENDS = "\n\r\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029"


def _zip(change: Callable[[bytes], bytes]) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr("x.xml", "<a/>")
    return change(made.getvalue())


def _nameless(packed: bytes) -> bytes:
    """The directory's entry has no name, which the library asks for its last letter."""
    at = packed.index(b"PK\x01\x02")
    entry = bytearray(packed[at:])
    entry[28:30] = b"\x00\x00"
    del entry[46:51]
    end = entry.index(b"PK\x05\x06")
    entry[end + 12:end + 16] = (len(entry[:end])).to_bytes(4, "little")
    return packed[:at] + bytes(entry)


def _of_another_version(packed: bytes) -> bytes:
    at = packed.index(b"PK\x01\x02")
    return packed[:at + 6] + b"\xed\x00" + packed[at + 8:]


def _of_spoilt_bytes(packed: bytes) -> bytes:
    """A task that says it is deflated, of bytes that are no such thing."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("TASKDATA/TASKDATA.XML", bytes(range(256)) * 9)
    spoilt = bytearray(made.getvalue())
    begin = spoilt.index(b"TASKDATA.XML") + len(b"TASKDATA.XML")
    spoilt[begin:begin + 40] = b"\xfd\x7f" * 20
    return bytes(spoilt)


def _job(path: Path) -> None:
    try:
        by_kind([str(path)])
    except ConfigError as error:
        assert all(line == one_line(line) for line in error.lines)
        raise ValueError(error.lines[0]) from None


CASES = {
    "bench table": (".csv", lambda end: f'"{end}x{end}"\n1,2\n'.encode(), lambda path: read_bench_table(path, None)),
    "plants": (".csv", lambda end: f"lat_deg,lon_deg\n34,1\nq{end}5,4\n".encode(), read_plants),
    "log": (".csv", lambda end: f"tim{end}e,b\n1,2\n".encode(), read_log),
    "job": (".yaml", lambda end: f'format: "topdress-j{end}{end}x"\n'.encode(), _job),
}


@pytest.mark.parametrize("end", ENDS, ids=lambda end: f"U+{ord(end):04X}")
@pytest.mark.parametrize("name", CASES)
def test_a_refusal_is_one_line_whatever_it_quotes(tmp_path: Path, name: str, end: str) -> None:
    suffix, content, read = CASES[name]
    path = tmp_path / f"x{suffix}"
    path.write_bytes(content(end))
    with pytest.raises(ValueError) as refused:
        read(path)
    assert len(str(refused.value).splitlines()) == 1
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("change", [_nameless, _of_another_version, _of_spoilt_bytes])
def test_a_zip_of_which_the_library_falls_over_is_refused_in_a_line(tmp_path: Path,
                                                                   change: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "x.zip"
    path.write_bytes(_zip(change))
    with pytest.raises(ValueError) as refused:
        read_prescription(path)
    assert len(str(refused.value).splitlines()) == 1 and str(path) in str(refused.value)


def test_one_line_leaves_the_words_and_takes_what_parts_or_steers() -> None:
    assert one_line(f"a{ENDS}b\x1b[2Jc") in ("a b[2Jc", "ab[2Jc")
    assert one_line("value x: allowed 1 to 5") == "value x: allowed 1 to 5"

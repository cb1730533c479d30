r"""How are the raw bytes of one device's line recorded, with times? `extract_received` returns all
bytes, so nothing is lost.

    # topdress-capture/1 gnss nmea0183 socket://127.0.0.1:4100
    12.345 < $GPGGA,...*47\r\n
    12.350 > $T1,...

Times are in s on the worker's clock (the run log's `time_s` plus the time of its first row). Each
line of the device has its own line, cut also where bytes came at different times. Backslashes and
bytes outside of printable ASCII are written as `\xNN`, line ends as `\r` and `\n`. Each datagram
has its own line.
"""

from __future__ import annotations

import re

CAPTURE_HEADER = b"# topdress-capture/1"
_ESCAPE_OF_BYTE = {13: "\\r", 10: "\\n", 92: "\\\\"}
_BYTE_OF_ESCAPE = {b"\\r": b"\r", b"\\n": b"\n", b"\\\\": b"\\"}
_ESCAPE = re.compile(rb"\\(?:x[0-9a-f]{2}|[rn\\])")
_CAPTURE_LINE = re.compile(rb"-?[0-9]+\.[0-9]{3} ([<>]) (.*)")


def make_capture_header(name: str, protocol: str, port: str) -> bytes:
    """Returns the first line of a capture."""
    return CAPTURE_HEADER + f" {name} {protocol} {port}\n".encode("ascii", "backslashreplace")


def make_capture_lines(time_s: float, direction: str, data: bytes) -> bytes:
    """Returns bytes received (`<`) or sent (`>`) at `time_s` as lines of a capture."""
    begin = f"{time_s:.3f} {direction} "
    return "".join(
        f"{begin}{_escape_bytes(piece)}\n" for piece in data.splitlines(keepends=True)
    ).encode()


def is_capture(data: bytes) -> bool:
    """Returns whether `data` begins with the first line of a capture."""
    return data.startswith(CAPTURE_HEADER)


def extract_received(capture: bytes) -> bytes:
    """Returns all received bytes in order. A truncated capture is read up to its last whole line.

    Raises
    ------
    ValueError : a line does not belong to a capture; the message gives its number.
    """
    found = []
    for number, line in enumerate(capture.split(b"\n")[:-1], start=1):
        if line.startswith(b"#"):
            continue
        match = _CAPTURE_LINE.fullmatch(line)
        if match is None:
            raise ValueError(
                f"line {number}: {line[:40]!r}: allowed is TIME_S < BYTES or TIME_S > BYTES"
            )
        if match[1] == b"<":
            found.append(_ESCAPE.sub(_unescape_match, match[2]))
    return b"".join(found)


def _escape_bytes(data: bytes) -> str:
    return "".join(
        _ESCAPE_OF_BYTE.get(byte) or (chr(byte) if 32 <= byte < 127 else f"\\x{byte:02x}")
        for byte in data
    )


def _unescape_match(match: re.Match[bytes]) -> bytes:
    text = match[0]
    return _BYTE_OF_ESCAPE.get(text) or bytes.fromhex(text[2:].decode())

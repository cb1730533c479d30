"""Rows that are longer than any row may be: they are left out and said, the others are read."""
from __future__ import annotations

from control.recordings.finding import Finding, many
from drivers.files.limits import LINE

_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def without_long_lines(data: bytes) -> tuple[bytes, list[Finding]]:
    """The text without the lines below its first that are longer than `LINE`, where others are left there; and what
    there is to say.

    Zero bytes, as a power loss leaves them, do not count; UTF-16 is left as it is.
    """
    long = [] if data.startswith(_UTF16) else _long_lines(data)
    if not long:
        return data, []
    starts_at = data.count(b"\n", 0, long[0][0]) + 1
    said = Finding("long_row", f"{many(len(long))} left out, the first in line {starts_at} with "
                   f"{long[0][1] - long[0][0]:,} bytes: allowed up to {LINE.most:,}", rows=len(long))
    ends = [0, *(min(end + 1, len(data)) for _start, end in long)]
    kept = b"".join([data[end:start] for end, start in zip(ends, [*(start for start, _end in long), len(data)],
                                                           strict=True)])
    return (kept, [said]) if kept.partition(b"\n")[2].strip() else (data, [])


def _long_lines(data: bytes) -> list[tuple[int, int]]:
    """First byte and line end of each. A line so long has no line end in one of the places half as long as is allowed:
    only those are looked at."""
    half, place, found = LINE.most // 2, 0, list[tuple[int, int]]()
    while place + half <= len(data):
        if data.find(b"\n", place, place + half) >= 0:
            place += half
            continue
        start, end = data.rfind(b"\n", 0, place) + 1, data.find(b"\n", place)
        end = len(data) if end < 0 else end
        if start > 0 and end - start - data.count(b"\0", start, end) > LINE.most:
            found.append((start, end))
        place += half * max(1, (end - place) // half)
    return found

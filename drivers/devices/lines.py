"""Bytes that arrive in any pieces, cut into lines; and the counts that every decoder keeps."""
from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field

_LINE_END = re.compile(rb"[\r\n]+")


class LineCutter:
    """Cuts a byte stream at CR and LF. A line longer than `longest` is given up, in `counts` rejected as `overlong`."""

    def __init__(self, counts: Counts, longest: int = 512) -> None:
        self._counts = counts
        self._longest = longest
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes]:
        """The lines completed by `data`, without their ends, empty ones left out."""
        pieces = _LINE_END.split(self._rest + data)
        self._rest = pieces.pop()
        if self._skipping and pieces:
            pieces.pop(0)
            self._skipping = False
        lines = [piece for piece in pieces if piece and len(piece) <= self._longest]
        overlong = sum(len(piece) > self._longest for piece in pieces)
        if len(self._rest) > self._longest:
            overlong += not self._skipping
            self._skipping = True
            self._rest = b""
        if overlong:
            self._counts.reject("overlong", overlong)
        return lines

    def flush(self) -> list[bytes]:
        """What stands after the last line end, as a line: for the end of a file."""
        rest, self._rest = self._rest, b""
        skipping, self._skipping = self._skipping, False
        return [rest] if rest and not skipping else []


@dataclass(slots=True)
class Counts:
    """What became of every sentence or frame: `read` = accepted + all rejected + all ignored."""

    read: int = 0
    accepted: int = 0
    rejected: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)

    def accept(self) -> None:
        self.read += 1
        self.accepted += 1

    def reject(self, kind: str, times: int = 1) -> None:
        self.read += times
        self.rejected[kind] += times

    def ignore(self, kind: str) -> None:
        self.read += 1
        self.ignored[kind] += 1

    @property
    def rejected_total(self) -> int:
        return sum(self.rejected.values())

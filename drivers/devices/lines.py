"""How are bytes that arrive in any pieces cut into lines, and how are faults counted? Every line
decoder is built on this module.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import ClassVar, Generic, TypeVar

_LINE_END = re.compile(rb"[\r\n]+")


class LineCutter:
    """Cuts a byte stream at CR and LF. A line longer than `longest` bytes is dropped and counted as
    rejected `overlong`."""

    def __init__(self, counts: Counts, longest: int = 512) -> None:
        self._counts = counts
        self._longest = longest
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes]:
        """Returns the lines completed by `data`, without their ends and without empty ones."""
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
        """Returns the bytes after the last line end as a line; for the end of a file."""
        rest, self._rest = self._rest, b""
        skipping, self._skipping = self._skipping, False
        return [rest] if rest and not skipping else []


@dataclass(slots=True)
class Counts:
    """Counts the result of every sentence or frame: `read` = accepted + all rejected + all
    ignored."""

    read: int = 0
    accepted: int = 0
    rejected: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)
    # Sentences that could come from another device, by which the protocol is not recognised.
    foreign: int = 0
    # Accepted sentences whose own numbers agree with each other.
    confirmed: int = 0

    def accept(self) -> None:
        """Counts one accepted line."""
        self.read += 1
        self.accepted += 1

    def reject(self, kind: str, times: int = 1) -> None:
        """Counts `times` faulty lines under the kind of their fault."""
        self.read += times
        self.rejected[kind] += times

    def ignore(self, kind: str) -> None:
        """Counts one valid but unused line under its kind."""
        self.read += 1
        self.ignored[kind] += 1

    @property
    def rejected_total(self) -> int:
        """Number of rejected lines of all kinds."""
        return sum(self.rejected.values())

    @property
    def recognised_total(self) -> int:
        """Number of sentences, used or not, that only this protocol contains."""
        return self.accepted + sum(self.ignored.values()) - self.foreign


class RejectedSentence(ValueError):
    """Reports a wrong sentence, frame or datagram; the argument is the kind under which the fault
    is counted."""


class IgnoredSentence(Exception):
    """Reports a valid but unused sentence; the argument is the kind under which the sentence is
    counted."""


class ForeignSentence(IgnoredSentence):
    """Reports a valid sentence that another device may have sent, such as a comment."""


Output = TypeVar("Output")


class Decoder(Generic[Output]):
    """Decodes the sentences of a protocol without opening a port or reading a clock. A subclass
    defines `_said`."""

    # The exception that `_said` raises for a wrong sentence.
    wrong: ClassVar[type[Exception]] = RejectedSentence
    # Number of sentences by which the protocol is recognised on a line.
    min_recognised: ClassVar[int] = 2

    def __init__(self) -> None:
        self.counts = Counts()

    def _decode_and_count(self, sentence: bytes, time_s: float) -> list[Output]:
        """Returns the readings of one sentence, and counts the sentence as accepted, rejected or
        ignored."""
        try:
            readings = self._decode_sentence(sentence, time_s)
        except IgnoredSentence as kind:
            self.counts.ignore(str(kind))
            self.counts.foreign += isinstance(kind, ForeignSentence)
            return []
        except self.wrong as kind:
            self.counts.reject(str(kind))
            return []
        self.counts.accept()
        return readings

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[Output]:
        """Returns the readings of one sentence. Raises RejectedSentence, Ignored."""
        raise NotImplementedError


class LineDecoder(Decoder[Output]):
    """Decodes a protocol of lines, which arrive in any pieces."""

    # Longest line, bytes.
    longest: ClassVar[int] = 512
    # Whether a line consists of frames that each begin with `$`.
    framed: ClassVar[bool] = False

    def __init__(self) -> None:
        super().__init__()
        self._cutter = LineCutter(self.counts, self.longest)

    def feed(self, data: bytes, time_s: float) -> list[Output]:
        """Returns the readings completed by `data`, which arrived at `time_s`; oldest first."""
        return [one for line in self._cutter.feed(data) for one in self._line(line, time_s)]

    def flush(self, time_s: float) -> list[Output]:
        """Ends a recording and returns the readings of a last line without a line end."""
        return [one for line in self._cutter.flush() for one in self._line(line, time_s)]

    def _line(self, line: bytes, time_s: float) -> list[Output]:
        """Returns the readings of one line; faults are counted by kind."""
        return [
            one
            for sentence in (self._split_frames(line) if self.framed else (line,))
            for one in self._decode_and_count(sentence, time_s)
        ]

    def _split_frames(self, line: bytes) -> list[bytes]:
        """Returns the frames of a line without their `$`; a new frame may follow a truncated frame
        at once."""
        before, *frames = line.split(b"$")
        if before.strip():
            self.counts.reject("garbage")
        return frames

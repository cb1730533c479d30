"""What commands say on a terminal: whatever stood in a file or came from a device steers nothing there."""
from __future__ import annotations

import io
import sys

from drivers.plain_text import plain

OVER_THE_LINE = "\r\x1b[K"          # our own lines of progress begin with it


class PlainOutput(io.TextIOWrapper):
    """A text stream that leaves out what steers a terminal, but for a progress line's beginning."""

    def write(self, text: str) -> int:
        own = OVER_THE_LINE if text.startswith(OVER_THE_LINE) else ""
        super().write(own + plain(text[len(own):]))
        return len(text)


def take_terminals() -> None:
    """From now on, for stdout and stderr where they are terminals. Files and pipes get every byte."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper) and stream.isatty():
            stream.flush()
            setattr(sys, name, PlainOutput(stream.buffer, encoding=stream.encoding, errors=stream.errors,
                                           line_buffering=True))

"""What commands say: on a terminal or to a pipe, where whatever stood in a file or came from a
device steers nothing; as JSON."""

from __future__ import annotations

import io
import json
import os
import shutil
import sys
import textwrap
from typing import Annotated, Any

import typer
from topdress.drivers.plain_text import STEERING, plain

AsJson = Annotated[
    bool, typer.Option("--json", help="The answer as JSON, alone on standard output.")
]

OVER_THE_LINE = "\r\x1b[K"  # our own lines of progress begin with it


RED, BLUE, NO_MORE = "\x1b[31m", "\x1b[34m", "\x1b[0m"
_AS_NUMBERS = {code: f"\\u{code:04x}" for code in STEERING}
INDENT = "    "  # of what a line goes on with


class PlainText(io.TextIOWrapper):
    """A text stream that leaves out what steers a terminal: one may stand behind a pipe, and
    whoever looks at a file looks on one."""

    def write(self, text: str) -> int:
        super().write(plain(text))
        return len(text)


class PlainOutput(io.TextIOWrapper):
    """The same on a terminal, but for a progress line's beginning; what is said while one
    stands takes its place. Lines that are too wide are broken between words. complains: lines
    come in colour, notes in another."""

    complains = False
    _progress_stands = False

    def write(self, text: str) -> int:
        own = OVER_THE_LINE if text.startswith(OVER_THE_LINE) else ""
        said = plain(text[len(own) :])
        if own:
            self._progress_stands = bool(said) and not said.endswith("\n")
        elif text:
            said = "\n".join(self._dressed(line) for line in said.split("\n"))
            own, self._progress_stands = OVER_THE_LINE if self._progress_stands else "", False
        super().write(own + said)
        return len(text)

    def _dressed(self, line: str) -> str:
        columns = shutil.get_terminal_size().columns
        if len(line) > columns > 2 * len(INDENT):
            line = "\n".join(
                textwrap.wrap(
                    line,
                    columns,
                    subsequent_indent=INDENT,
                    break_long_words=False,
                    break_on_hyphens=False,
                    replace_whitespace=False,
                    drop_whitespace=True,
                )
            )
        if (
            not (self.complains and line.strip())
            or os.environ.get("NO_COLOR")
            or os.environ.get("TERM") == "dumb"
        ):
            return line
        return f"{BLUE if line.startswith('note: ') else RED}{line}{NO_MORE}"


def print_json(found: Any) -> None:
    """A line of JSON: by the names of fields, which have the units in them; null for what is no
    number."""
    from topdress.drivers.files.plain import plain as as_data

    typer.echo(
        format_json_line(json.loads(json.dumps(as_data(found)), parse_constant=lambda _: None))
    )


def format_json_line(found: Any, separators: tuple[str, str] | None = None) -> str:
    """Returns the data as one line of JSON, in which what steers a terminal stands as its
    number (\\u009b): whoever reads it as JSON has every character."""
    line = json.dumps(found, separators=separators, ensure_ascii=False)
    return line if line.isprintable() else line.translate(_AS_NUMBERS)


def take_outputs() -> None:
    """Replaces stdout and stderr, for the rest of the process, by streams on which no text
    steers a terminal."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if not isinstance(stream, io.TextIOWrapper):
            continue
        stream.flush()
        kind = PlainOutput if stream.isatty() else PlainText
        plainer = kind(
            stream.buffer,
            encoding=stream.encoding,
            errors=stream.errors,
            line_buffering=stream.line_buffering,
            write_through=stream.write_through,
        )
        if isinstance(plainer, PlainOutput):
            plainer.complains = name == "stderr"
        setattr(sys, name, plainer)

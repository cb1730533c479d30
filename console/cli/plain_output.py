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
from topdress.drivers.plain_text import CONTROL_CODES, remove_control_characters

AsJson = Annotated[
    bool, typer.Option("--json", help="The answer as JSON, alone on standard output.")
]

LINE_START = "\r\x1b[K"  # our own lines of progress begin with it


RED_CODE, BLUE_CODE, RESET_CODE = "\x1b[31m", "\x1b[34m", "\x1b[0m"
_STEERING_NUMBERS = {code: f"\\u{code:04x}" for code in CONTROL_CODES}
CONTINUATION = "    "  # of what a line goes on with


class PlainText(io.TextIOWrapper):
    """Removes characters that control a terminal, because a terminal may follow a pipe, and a file
    may be shown on one."""

    def write(self, text: str) -> int:
        super().write(remove_control_characters(text))
        return len(text)


class PlainOutput(io.TextIOWrapper):
    """Removes control characters on a terminal, except at the beginning of a progress line; text
    that is printed during progress replaces it.

    Lines that are too wide are broken between words. `complains` selects colours for lines and
    notes.
    """

    complains = False
    _progress_stands = False

    def write(self, text: str) -> int:
        own = LINE_START if text.startswith(LINE_START) else ""
        said = remove_control_characters(text[len(own) :])
        if own:
            self._progress_stands = bool(said) and not said.endswith("\n")
        elif text:
            said = "\n".join(self._dress_line(line) for line in said.split("\n"))
            own, self._progress_stands = LINE_START if self._progress_stands else "", False
        super().write(own + said)
        return len(text)

    def _dress_line(self, line: str) -> str:
        columns = shutil.get_terminal_size().columns
        if len(line) > columns > 2 * len(CONTINUATION):
            line = "\n".join(
                textwrap.wrap(
                    line,
                    columns,
                    subsequent_indent=CONTINUATION,
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
        return f"{BLUE_CODE if line.startswith('note: ') else RED_CODE}{line}{RESET_CODE}"


def print_json(found: Any) -> None:
    """Prints a line of JSON with the names of fields, which contain their units; null for a value
    that is no number."""
    from topdress.drivers.files.plain_data import convert_to_plain as as_data

    typer.echo(
        format_json_line(json.loads(json.dumps(as_data(found)), parse_constant=lambda _: None))
    )


def format_json_line(found: Any, separators: tuple[str, str] | None = None) -> str:
    r"""Returns the data as one line of JSON in which characters that control a terminal are written
    as numbers (\u009b), so that a JSON reader gets every character."""
    line = json.dumps(found, separators=separators, ensure_ascii=False)
    return line if line.isprintable() else line.translate(_STEERING_NUMBERS)


def replace_streams() -> None:
    """Replaces stdout and stderr, for the rest of the process, by streams on which no text can
    control a terminal."""
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

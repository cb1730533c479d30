"""How do commands report errors? They print plain lines on stderr and exit with a non-zero code,
without a traceback for faults that the user can correct.

A wrong file or value raises ValueError, or ConfigError for several lines. Only this module turns
errors into lines and exit codes; any other exception is a fault of the program and is also reported
in one line.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from math import isfinite
from typing import Any, TypeVar

import typer
from topdress.console.running import WorkerFailed
from topdress.drivers.files.config_error import ConfigError
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.plain_text import join_lines

CommandFunction = TypeVar("CommandFunction", bound=Callable[..., Any])


# Exit codes, which `topdress --help` lists.
EXIT_FAILED, EXIT_WRONG, EXIT_NOT_JUDGED, EXIT_OUR_FAULT, EXIT_CANCELLED = 1, 2, 3, 70, 130


class CommandError(Exception):
    """Holds one plain line for the user."""


def guard_command(command: CommandFunction) -> CommandFunction:
    """The command with its expected errors turned into lines."""

    @functools.wraps(command)
    def run_guarded(*args: Any, **kwargs: Any) -> Any:
        try:
            _refuse_not_finite(kwargs)
            return command(*args, **kwargs)
        except (ConfigError, TableError) as error:
            for line in error.lines:
                typer.echo(line, err=True)
            raise typer.Exit(EXIT_WRONG) from None
        except (CommandError, ValueError, WorkerFailed) as error:
            typer.echo(join_lines(str(error)) or type(error).__name__, err=True)
            raise typer.Exit(EXIT_WRONG) from None
        except BrokenPipeError:  # `topdress decode ... | head` is no error
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(0) from None
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            # A file that does not exist is a mistake of the user.
            gone = isinstance(error, FileNotFoundError)
            typer.echo(f"{where}{'no such file' if gone else error.strerror or error}", err=True)
            raise typer.Exit(EXIT_WRONG if gone else EXIT_FAILED) from None
        except KeyboardInterrupt:
            # a terminal that has hung up hears nothing more
            with contextlib.suppress(OSError):
                typer.echo("cancelled", err=True)
            raise typer.Exit(EXIT_CANCELLED) from None
        except (typer.Exit, typer.Abort, typer.BadParameter):
            raise
        except Exception as error:
            line, code = _describe_unforeseen(error)
            typer.echo(line, err=True)
            raise typer.Exit(code) from None

    return run_guarded  # type: ignore[return-value]


def _describe_unforeseen(error: Exception) -> tuple[str, int]:
    """A line and an exit code. The trace of an unforeseen error is for us, the line for the user;
    for a part that is not installed, the line installs it."""
    from topdress.drivers.files.optional_packages import find_extra, format_extra_line

    if (
        isinstance(error, ModuleNotFoundError)
        and (extra := find_extra(error.name or "")) is not None
    ):
        return (
            f"this needs the extra {extra}, not installed: {format_extra_line(extra)}",
            EXIT_WRONG,
        )
    said = join_lines(str(error))[:200]
    return f"a fault of topdress: {type(error).__name__}: {said}; {_keep_trace()}", EXIT_OUR_FAULT


def _refuse_not_finite(given: Mapping[str, Any]) -> None:
    """Raises CommandError for nan and inf, which Python reads as numbers and no option takes."""
    for name, value in given.items():
        for one in value if isinstance(value, list | tuple) else (value,):
            if isinstance(one, float) and not isfinite(one):
                raise CommandError(
                    f"--{name.replace('_', '-')} {one}: allowed is a number, not {one}"
                )


def _keep_trace() -> str:
    """Keep the trace of the error at hand and return its place; it is asked for when somebody
    reports it."""
    import tempfile
    import traceback

    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="topdress-fault-", suffix=".txt", delete=False, encoding="utf-8"
        ) as kept:
            kept.write(traceback.format_exc())
    except OSError:
        return "its trace could not be kept"
    return f"its trace is in {kept.name}: please report it"


def print_note_lines(notes: Iterable[object], where: str = "") -> None:
    """Print notes on the files that were read, a line each on stderr. where: before each."""
    for one in notes:
        typer.echo(f"note: {where}{one}", err=True)


def has_terminal() -> bool:
    """Whether standard input and output are a terminal."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty()


def need_terminal(command: str, instead: str) -> None:
    """Raises CommandError for a command that draws on a terminal where there is none, with another
    that works there."""
    if not has_terminal():
        raise CommandError(f"{command} needs a terminal; without one: {instead}")

"""Errors of a command in plain lines on stderr and a non-zero exit; never a trace for what the user can put right.

Whatever says what is wrong with a file or a value is a ValueError, or a ConfigError where it may be several lines.
"""
from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from typing import Any, TypeVar

import typer

from drivers.files.config import ConfigError

F = TypeVar("F", bound=Callable[..., Any])


class CommandError(Exception):
    """One plain line for the user."""


def guarded(command: F) -> F:
    """The command with its expected errors turned into lines."""
    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> Any:
        try:
            return command(*args, **kwargs)
        except ConfigError as error:
            for line in error.lines:
                typer.echo(line, err=True)
            raise typer.Exit(2) from None
        except (CommandError, ValueError) as error:
            typer.echo(str(error).splitlines()[0], err=True)
            raise typer.Exit(2) from None
        except BrokenPipeError:             # `topdress decode ... | head` is no error
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(0) from None
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            typer.echo(f"{where}{error.strerror or error}", err=True)
            raise typer.Exit(1) from None
        except KeyboardInterrupt:
            typer.echo("cancelled", err=True)
            raise typer.Exit(130) from None
    return run  # type: ignore[return-value]

"""`topdress check`: is this configuration file right?"""
from __future__ import annotations

from typing import Annotated

import typer


def check(files: Annotated[list[str], typer.Argument(metavar="CFG...", help="Configuration files, or names of "
                                                     "shipped ones.")]) -> None:
    """Check configuration files of any kind; one plain line for each thing that is wrong."""
    from drivers.files.config import ConfigError, load_any
    from drivers.files.kinds import KINDS
    wrong: list[str] = []
    for file in files:
        try:
            kind, loaded = load_any(file, KINDS)
        except ConfigError as error:
            wrong += error.lines
            continue
        typer.echo(f"{loaded.path}: ok ({kind.format})")
        for warning in getattr(loaded.model, "warnings", ()):
            typer.echo(f"{loaded.path}: note: {warning}")
    if wrong:
        raise ConfigError(wrong)

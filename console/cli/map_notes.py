"""What of a job's map will not be applied as it stands, a line each on the error stream."""
from __future__ import annotations

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from control.targets.map_check import MapCheck


def print_map_notes(check: MapCheck | None, label: str, warnings: tuple[str, ...] = ()) -> None:
    """Nothing of a map where the job names none. warnings: of the job's file."""
    from console.app.pages.job.map_words import map_words
    from console.app.units import METRIC
    for line in (*warnings, *(() if check is None else map_words(check, METRIC))):
        typer.echo(f"{label}: note: {line}", err=True)

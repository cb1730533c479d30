"""How does `topdress history` show the changes of a machine file by diagnoses, and undo the last
change?
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from topdress.console.cli.inputs import load_machine, require_suffix
from topdress.console.cli.outputs import ForceOption, Output, find_machine_file, refuse_collisions
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.drivers import day_clock


def print_history(
    machine: Annotated[
        str, typer.Argument(metavar="MACHINE", help="Machine file, or name of a shipped one.")
    ],
    undo: Annotated[bool, typer.Option("--undo", help="Take the last change back.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="NEW.yaml",
            help="Of --undo: where the machine without it goes; the file itself stays as it is.",
        ),
    ] = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """List what diagnoses changed in a machine file: day, data, each effect before and after,
    each term."""
    from topdress.console.reports.term_words import compare_side_by_side
    from topdress.control.machine.history import find_last_change, undo_last_change
    from topdress.drivers.files.config import save_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    if undo != (out is not None):
        raise CommandError(
            "history: --undo and --out NEW.yaml are given together: the file itself is not "
            "written over"
        )
    require_suffix("--out", out, ".yaml", ".yml")
    loaded = load_machine(machine)
    if out is not None:
        refuse_collisions([find_machine_file(machine)], [Output((out,))], force)
        last = find_last_change(loaded)
        save_config(
            out, undo_last_change(loaded, date=day_clock.read_today().isoformat()), MACHINE_KIND
        )
        assert last is not None
        if as_json:
            print_json(last)
            return
        typer.echo(f"taken back, {out} is without it:")
        typer.echo("\n".join(compare_side_by_side(last)))
        return
    if as_json:
        print_json(loaded.history)
        return
    if not loaded.history:
        typer.echo(f"{machine}: no diagnosis changed this file")
    for one in loaded.history:
        state = f", taken back {one.undone}" if one.undone else ""
        typer.echo(f"{one.date or 'no date'}, from {one.data or 'unknown data'}{state}")
        typer.echo("\n".join(compare_side_by_side(one)))

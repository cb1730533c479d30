"""How does `topdress effects` list the catalogue?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from topdress.console.cli.inputs import load_machine
from topdress.console.cli.outputs import (
    ForceOption,
    find_machine_file,
    make_marked_output,
    refuse_collisions,
)
from topdress.console.cli.plain_errors import print_note_lines
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.console.cli.terms import describe_terms
from topdress.drivers import plugins


def list_effects(
    as_json: AsJson = False,
    as_page: Annotated[
        Path | None,
        typer.Option(
            "--markdown", metavar="OUT", help="Write the catalogue as a page of Markdown."
        ),
    ] = None,
    machine: Annotated[
        str,
        typer.Option(
            metavar="MACHINE",
            help="Machine file, or name of a shipped one: bounds of sizes are shares of "
            "its ranges.",
        ),
    ] = "huanghai",
    force: ForceOption = False,
) -> None:
    """List the catalogue of effects: what each is, its unit and range, where it shows, its
    source."""
    from topdress.control.machine.machine import CATALOGUE, describe_unit, find_size_bounds

    loaded = load_machine(machine)
    if as_page is not None:
        from topdress.console.reports.effects_page import format_effects_page
        from topdress.drivers.files.atomic_files import write_atomically

        refuse_collisions(
            [find_machine_file(machine)],
            [make_marked_output(as_page, b"topdress effects --markdown")],
            force,
        )
        write_atomically(as_page, format_effects_page(CATALOGUE, loaded))
        if not as_json:
            return
    if as_json:
        print_json(
            [
                {
                    "id": e.effect.id,
                    "unit": describe_unit(e.effect.id, loaded),
                    "low": find_size_bounds(e.effect.id, loaded).low,
                    "high": find_size_bounds(e.effect.id, loaded).high,
                    "title": e.effect.title,
                    "physics": e.effect.physics,
                    "source": e.effect.source,
                    "seen_in": list(e.effect.seen_in),
                    "advice": e.effect.advice,
                    "separate": e.effect.separate,
                }
                for e in CATALOGUE.values()
            ]
        )
        return
    for e in CATALOGUE.values():
        effect = e.effect
        low, high = find_size_bounds(effect.id, loaded)
        typer.echo(f"{effect.id}  ({describe_unit(effect.id, loaded)}; {low:g} to {high:g})")
        typer.echo(f"    {effect.title}. {effect.physics}")
        typer.echo(f"    seen in: {', '.join(effect.seen_in)}. source: {effect.source}")
        typer.echo(f"    do: {effect.advice}")
        typer.echo(f"    tell apart: {effect.separate}")
    _note_plugin_effects()
    for line in describe_terms():
        typer.echo(line)


def _note_plugin_effects() -> None:
    """Prints the effects that other packages add; an effect that cannot be loaded is a note on
    stderr."""
    for name in plugins.find_entry_points("effects"):
        try:
            plugin = plugins.find_effect(name)
        except plugins.PluginFault as fault:
            print_note_lines([fault])
            continue
        if plugin is not None:
            typer.echo(
                f"{name}  (a plug-in's)\n    {plugin.title}. As a term: {plugin.term}\n    do: "
                f"{plugin.advice}"
            )

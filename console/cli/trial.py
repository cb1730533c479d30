"""How does `topdress trial` show plots on one page, with applied amounts, weights and yields?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from topdress.console.cli.inputs import LOG_KINDS, load_machine, refuse_other_kinds
from topdress.console.cli.outputs import (
    ForceOption,
    find_machine_file,
    list_log_files,
    make_marked_output,
    refuse_collisions,
)
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.plain_output import AsJson, print_json


def run_trial(
    plots: Annotated[
        Path,
        typer.Argument(
            metavar="PLOTS",
            help="An outline for each plot, with its name: GeoJSON, shapefile, KML, GeoPackage.",
        ),
    ],
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The run that sensed and spread.")],
    weights: Annotated[
        Path | None,
        typer.Argument(
            metavar="WEIGHTS.csv",
            help="Columns plot, treatment, applied_kg, "
            "sample_kg, sample_m2; a row for each thing weighed.",
        ),
    ] = None,
    after: Annotated[
        Path | None, typer.Option(metavar="LOG", help="A run that sensed the plots later.")
    ] = None,
    control: Annotated[
        str | None,
        typer.Option(
            metavar="TREATMENT",
            help="What the others are held against; without it the one that got least.",
        ),
    ] = None,
    machine: Annotated[
        str | None, typer.Option(metavar="MACHINE", help="Of logs that name none.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="PAGE.html", help="The page.")] = Path("trial.html"),
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Look at a trial of one's own as the decision paper does: canopy, decision rate, amounts
    and yields by plot."""
    from topdress.console.reports.html import GENERATOR_META
    from topdress.console.reports.paper_page import make_paper_page
    from topdress.control.papers.field_trial import make_trial_section
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.run_meta import find_software_version
    from topdress.drivers.files.trial_plots import read_trial

    refuse_other_kinds([one for one in (log, after) if one is not None], LOG_KINDS)
    reads = [
        plots,
        *(file for one in (log, after) if one is not None for file in list_log_files(one)),
        *([] if weights is None else [weights]),
        *([] if machine is None else [find_machine_file(machine)]),
    ]
    refuse_collisions(reads, [make_marked_output(out, GENERATOR_META.encode())], force)
    found = read_trial(plots, log, weights, after, load_machine(machine) if machine else None)
    try:
        section = make_trial_section(found, control)
    except ValueError as error:
        raise CommandError(str(error)) from None
    write_atomically(
        out, make_paper_page([section], f"topdress {find_software_version()}", "Trial, by plot")
    )
    if as_json:
        print_json({"words": section.words, "tables": section.tables})
    else:
        typer.echo("\n".join(section.words))
    typer.echo(f"written      {out}", err=as_json)

"""How does `topdress reproduce` show the papers' tables and figures, published next to computed, on
one page?
"""

from __future__ import annotations

import csv
import datetime as dt
import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.outputs import ForceOption, make_marked_output, refuse_collisions
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.console.cli.progress import iterate_with_progress

if TYPE_CHECKING:
    from topdress.control.papers.page import Section, Table

# The decision paper's day of sensing.
PAPER_DAY = dt.date(2014, 3, 7)
PAGE_NAME = "reproduce.html"


def reproduce_papers(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the page and a CSV of every table.")
    ] = Path("reproduce"),
    seed: Annotated[
        int, typer.Option(metavar="NUMBER", min=0, help="Of the simulated canopies and noise.")
    ] = 1,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Recompute the three papers: published next to obtained."""
    from topdress.console.reports.html import GENERATOR_META
    from topdress.console.reports.paper_page import make_paper_page
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.run_meta import find_software_version

    before = [*out.glob("[0-9]-[0-9]*.csv")]
    refuse_collisions(
        (), [make_marked_output(out / PAGE_NAME, GENERATOR_META.encode(), before)], force
    )
    sections = run_papers(seed)
    out.mkdir(parents=True, exist_ok=True)
    for number, section in enumerate(sections):
        for k, table in enumerate(section.tables, start=1):
            write_atomically(out / f"{number}-{k}.csv", format_table_csv(table))
    write_atomically(
        out / PAGE_NAME, make_paper_page(sections, f"topdress {find_software_version()}")
    )
    if as_json:
        print_json(
            [{"title": one.title, "words": one.words, "tables": one.tables} for one in sections]
        )
    else:
        for section in sections:
            typer.echo("\n    ".join((section.title, *section.words)))
    typer.echo(f"written      {out / PAGE_NAME}", err=as_json)


def run_papers(seed: int) -> list[Section]:
    """Returns every section of the page. Takes about half a minute."""
    from topdress.control.papers.decision_paper import make_decision_section
    from topdress.control.papers.lag_paper import make_lag_section
    from topdress.control.papers.page import summarise_claims
    from topdress.control.papers.paper_elements import make_elements_section
    from topdress.control.papers.point_paper import make_points_section
    from topdress.drivers.files.run_setup import load_setup

    setup = load_setup("huanghai", "demo", PAPER_DAY)
    papers: list[Callable[[], Section]] = [
        lambda: make_decision_section(setup.machine, setup.crop, seed),
        lambda: make_lag_section(setup.machine),
        make_points_section,
    ]
    sections = [paper() for paper in iterate_with_progress(papers, len(papers), "papers")]
    return [summarise_claims(sections), *sections, make_elements_section()]


def format_table_csv(table: Table) -> str:
    """Returns one table as CSV with its title as a comment and numbers in full precision."""
    text = io.StringIO()
    text.write(f"# {table.title}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows(["" if cell is None else cell for cell in row] for row in table.rows)
    return text.getvalue()

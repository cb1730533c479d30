"""How does `topdress compare` show the errors of two machine files on logs to which neither was
fitted?
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.inputs import load_machine
from topdress.console.cli.outputs import (
    ForceOption,
    find_machine_file,
    list_log_files,
    make_marked_output,
    refuse_collisions,
)
from topdress.console.cli.plain_errors import EXIT_NOT_JUDGED, print_note_lines
from topdress.console.cli.progress import ProgressLine

if TYPE_CHECKING:
    from topdress.control.diagnosis.runs.compared import Compared
    from topdress.control.machine.machine import Machine


def compare_machines(
    old: Annotated[
        str, typer.Argument(metavar="OLD.yaml", help="Machine file, or name of a shipped one.")
    ],
    new: Annotated[
        str, typer.Argument(metavar="NEW.yaml", help="The machine file that is held against it.")
    ],
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...", help="Logs of that machine that neither file was fitted to."
        ),
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="The result as JSON on standard output.")
    ] = False,
    report: Annotated[
        Path | None, typer.Option(metavar="OUT.html", help="A page with pictures.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Say which of two machine files predicts logs better: the error of each, channel by
    channel, and the difference.

    Exit code 3: no channel of any log could be held against both.
    """
    from topdress.console.reports.html import GENERATOR_META

    machines = [load_machine(name) for name in (old, new)]
    reads = [
        *(file for log in logs for file in list_log_files(log)),
        *map(find_machine_file, (old, new)),
    ]
    refuse_collisions(
        reads,
        [] if report is None else [make_marked_output(report, GENERATOR_META.encode())],
        force,
    )
    found = _compare_on_logs(logs, machines[0], machines[1], new)
    _write_result(found, old, new, as_json, report)
    if not any(one.channels for _, one in found):
        raise typer.Exit(EXIT_NOT_JUDGED)


def _compare_on_logs(
    logs: list[Path], old: Machine, new: Machine, name: str
) -> list[tuple[str, Compared]]:
    from topdress.control.diagnosis.runs.compared import compared
    from topdress.drivers.files.any_log import open_any_log

    line, found = ProgressLine(), []
    try:
        for number, path in enumerate(logs):

            def show_step(share: float, word: str, number: int = number, path: Path = path) -> None:
                done = 100.0 * (number + share) / len(logs)
                line.show_text(f"{done:3.0f} % {path.name} {word} (Ctrl-C cancels)")

            log = open_any_log(path)
            one = compared(
                dict(log.columns), old, new, show_step if line.shown else lambda share, word: None
            )
            line.clear_line()
            odd = [
                str(one)
                for one in log.findings
                if one.id != "missing" or not (old.stages and new.stages)
            ]
            notes = [*odd, *one.findings, *_note_fitted_logs(path, old, new)]
            notes += [] if one.channels else [f"no channel of it could be held against {name}"]
            print_note_lines(dict.fromkeys(notes), f"{path}: ")
            found.append((str(path), one))
    finally:
        line.clear_line()
    return found


def _note_fitted_logs(path: Path, *machines: Machine) -> list[str]:
    """Returns a note for a log from which one of the files was made, because its error on that log
    does not predict errors on others."""
    from topdress.drivers.files.config import calc_sha256

    own = {
        sha
        for machine in machines
        for sha in (
            *(one.sha256 for one in machine.adopted),
            *(one.sha256 for one in machine.history),
            *(term.source.sha256 for term in machine.terms),
        )
        if sha
    }
    if own and path.is_file() and calc_sha256(path) in own:
        return [
            "a machine file was fitted to this very log: how it does on another log is not "
            "seen here"
        ]
    return []


def _write_result(
    found: list[tuple[str, Compared]], old: str, new: str, as_json: bool, report: Path | None
) -> None:
    from topdress.console.reports.compare_page import list_plain_data, summarise_terminal

    if as_json:
        typer.echo(json.dumps(list_plain_data(found), indent=1))
    else:
        for line in summarise_terminal(found, old, new):
            typer.echo(line)
    if report is not None:
        from topdress.console.reports.compare_page import make_compare_page
        from topdress.drivers.files.atomic_files import write_atomically

        write_atomically(report, make_compare_page(found, old, new))
        typer.echo(f"report: {report}", err=True)

"""How does `topdress run` open the console on a running or newly started control worker?"""

from __future__ import annotations

from typing import Annotated

import typer
from topdress.console.attached_consoles import NAME_VARIABLE


def run_console(
    *,
    job: Annotated[
        str | None,
        typer.Argument(
            metavar="JOB",
            help="A job file, or the name of one of yours or of those "
            "that are shipped. With it nothing is asked at the start.",
        ),
    ] = None,
    config: Annotated[
        list[str] | None,
        typer.Option(
            "--config",
            metavar="CFG",
            help="Job, machine, crop or cab file; repeatable. Without it: the simulated machine.",
        ),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID=SIZE", help="Plant an effect in the simulated machine (repeatable)."
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(metavar="NUMBER", min=0, help="Of the simulated machine.")
    ] = 1,
    hz: Annotated[
        float, typer.Option(metavar="HZ", min=5.0, max=100.0, help="Control ticks a second.")
    ] = 20.0,
    log: Annotated[
        str | None,
        typer.Option(
            metavar="NAME.csv", help="Run log. Without it: a new file in the user's data folder."
        ),
    ] = None,
    model_check: Annotated[
        bool,
        typer.Option(
            help="Compare the log with the machine model while it grows, in a process of its own."
        ),
    ] = True,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            envvar=NAME_VARIABLE,
            help="What the others at this "
            "machine and its log call this console. Without it: user, computer, "
            "terminal.",
        ),
    ] = None,
) -> None:
    """The console. Attaches to the control worker that runs, or starts one."""
    from topdress.console.cli.screens import find_own_job, show_run

    named = () if job is None else (find_own_job(job),)
    show_run((*named, *(config or ())), tuple(effect or ()), seed, hz, log, model_check, name)

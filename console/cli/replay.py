"""How does `topdress replay` show a run log on the screen, or run it again through the control loop
without a screen?
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.inputs import LOG_KINDS, refuse_bench_table, refuse_other_kinds
from topdress.console.cli.outputs import ForceOption, list_log_files, refuse_collisions
from topdress.console.cli.plain_errors import CommandError, print_note_lines
from topdress.console.cli.progress import iterate_with_progress
from topdress.console.cli.whole_log import make_log_output, open_whole_log
from topdress.control.orders import Strategy

if TYPE_CHECKING:
    from topdress.drivers.files.read_log import RunLog
    from topdress.drivers.files.run_setup import Setup


def replay_log(
    log: Annotated[
        Path, typer.Argument(metavar="LOG.csv", help="A run log, ours or of another program.")
    ],
    headless: Annotated[
        bool,
        typer.Option(
            "--headless",
            help="No screen: run the control loop on the logged measurements as fast as it goes.",
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="NEW.csv", help="With --headless: log of the new run.")
    ] = None,
    machine: Annotated[
        str | None, typer.Option(metavar="MACHINE", help="Instead of the log's.")
    ] = None,
    job: Annotated[str | None, typer.Option(metavar="JOB", help="Instead of the log's.")] = None,
    strategy: Annotated[Strategy | None, typer.Option(help="Instead of the log's.")] = None,
    force: ForceOption = False,
) -> None:
    """Replay a log: as recorded on the screen, or as it would have been decided."""
    from topdress.console.services.replay_rerun import load_rerun_setup
    from topdress.drivers.files.any_log import open_any_log

    refuse_other_kinds([log], LOG_KINDS)
    refuse_bench_table(log, "replay")
    recorded = open_any_log(log)
    if not headless:
        if out is not None:
            raise CommandError("--out goes with --headless")
        from topdress.console.cli.screens import show_replay

        show_replay(recorded)
        return
    if out is None:
        raise CommandError("--headless needs --out NEW.csv")
    setup = load_rerun_setup(recorded, machine, job, strategy)
    refuse_collisions((*list_log_files(log), *setup.files), [make_log_output(out)], force)
    out.parent.mkdir(parents=True, exist_ok=True)
    _run_headless(recorded, out, setup)


def _run_headless(recorded: RunLog, out: Path, setup: Setup) -> None:
    from topdress.console.services.replay_rerun import rerun_loop
    from topdress.drivers.files.run_meta import make_run_meta

    print_note_lines((*recorded.findings, *setup.job.warnings))
    started = time.perf_counter()
    meta = make_run_meta(
        setup.machine,
        setup.crop,
        setup.job,
        sha256=setup.sha256,
        extra={"replay_of": str(recorded.path), "job_folder": str(setup.folder)},
    )
    with open_whole_log(out, meta) as new:
        for tick in iterate_with_progress(rerun_loop(recorded, setup), len(recorded), "replaying"):
            new.append(tick.row)
    took = time.perf_counter() - started
    typer.echo(
        f"{len(recorded)} rows, {recorded.duration_s:.0f} s replayed in {took:.1f} s "
        f"({recorded.duration_s / max(took, 1e-9):.0f} times real time): {out}"
    )

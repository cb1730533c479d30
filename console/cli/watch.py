"""How does `topdress watch` compare a growing log with the machine model while the machine
works?
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.inputs import LOG_KINDS, refuse_bench_table, refuse_other_kinds
from topdress.console.cli.plain_output import AsJson, print_json

if TYPE_CHECKING:
    from topdress.control.diagnosis.result import ModelDeviation


def watch_log(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG",
            help="A run log that grows, of this machine or any other; or one that is done.",
        ),
    ],
    machine: Annotated[
        str | None,
        typer.Option(
            metavar="MACHINE",
            help="Machine file, or name of a shipped one; "
            "default: the one that the log names, else huanghai.",
        ),
    ] = None,
    to_end: Annotated[
        bool, typer.Option("--to-end", help="End with the log instead of waiting for more of it.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Tell in one line when the machine departs from its model, and when it is back. Ctrl-C
    ends."""
    from topdress.console.cli.plain_errors import CommandError
    from topdress.console.services.live_check import LOG_POLL_S, follow_log, lower_priority
    from topdress.control.diagnosis.live.growing_log_check import MIN_LOG_S

    if log.exists() or to_end:
        refuse_other_kinds([log], LOG_KINDS)
        refuse_bench_table(log, "watch")
    _print_start(log, to_end)
    lower_priority()
    begin, looks, last = time.monotonic(), 0, None

    def wait_for_poll() -> bool:
        if not to_end:
            time.sleep(LOG_POLL_S)
        return not to_end

    try:
        for look in follow_log(
            log, machine, wait_for_poll, lambda said: typer.echo(said, err=True)
        ):
            looks += 1
            if look.departure != last:
                if as_json:
                    print_json({"at_s": look.at_s, "departure": look.departure})
                else:
                    typer.echo(
                        f"{format_log_time(look.at_s)}  {describe_departure(look.departure)}"
                    )
            last = look.departure
    except KeyboardInterrupt:
        pass
    if to_end and not looks:
        raise CommandError(
            f"{log}: too short: nothing is said before {MIN_LOG_S / 60.0:.0f} minutes of rows"
        )
    used_s, took_s = time.process_time(), time.monotonic() - begin
    typer.echo(f"{looks} looks; {used_s:.0f} s of processor in {took_s:.0f} s", err=True)


def _print_start(log: Path, to_end: bool) -> None:
    from topdress.console.cli.plain_errors import CommandError

    if not to_end:
        typer.echo(
            f"{log}: {'watched' if log.exists() else 'waited for'}; a line comes when the "
            "machine departs from "
            "its model; Ctrl-C ends",
            err=True,
        )
    elif not log.exists():
        raise CommandError(f"{log}: no such file")


def describe_departure(departure: ModelDeviation | None) -> str:
    """Returns the departure and its remedy in one line, with times of the log."""
    from topdress.console.reports.live_words import describe_next_step, format_departure

    if departure is None:
        return "as the model says again"
    since = "" if departure.since_s is None else format_log_time(departure.since_s)
    return f"{format_departure(departure, since)}; {describe_next_step(departure, console=False)}"


def format_log_time(seconds: float) -> str:
    """Returns a time of the log as h:mm:ss."""
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"

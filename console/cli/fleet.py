"""How does `topdress fleet` diagnose a season of logs of many machines, on this computer or a Dask
cluster?
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.outputs import ForceOption, make_marked_output, refuse_collisions
from topdress.console.cli.plain_errors import EXIT_CANCELLED, CommandError
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.console.cli.progress import ProgressLine
from topdress.drivers import day_clock

if TYPE_CHECKING:
    from topdress.console.services.fleet import FleetFindings
    from topdress.console.services.fleet_metadata import ListedLogs

REPORT_NAME = "report.html"
# Interval of progress lines without a terminal, s.
PROGRESS_PERIOD_S = 30.0
# Number of listed rows that belong to no log.
MAX_STRAY_ROWS = 20


def run_fleet(
    paths: Annotated[
        list[str],
        typer.Argument(
            metavar="PATHS...",
            help="Logs, folders of logs, patterns with stars, "
            "fsspec URLs; CSV or Parquet, of any machine.",
        ),
    ],
    *,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Report, data, and what was done already: a second run "
            "diagnoses only what is new.",
        ),
    ],
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Of a Dask cluster, as tcp://host:8786. Without it: workers on this computer.",
        ),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, metavar="NUMBER", help="On this computer.")] = max(
        1, os.cpu_count() or 1
    ),
    machine: Annotated[
        str,
        typer.Option(
            metavar="MACHINE",
            help="Machine file, or name of a shipped one, for logs that name none.",
        ),
    ] = "huanghai",
    about: Annotated[
        str | None,
        typer.Option(
            metavar="TABLE.csv",
            help="What the logs do not say: a column log (a "
            "path, or as much of its end as one log has), and unit, product, "
            "operator, field, time.",
        ),
    ] = None,
    price: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="MONEY", help="Of a kilogram: the report then counts money."),
    ] = None,
    currency: Annotated[str, typer.Option(metavar="NAME", help="Of the money.")] = "CNY",
    storage: Annotated[
        list[str] | None,
        typer.Option(
            "--storage-option",
            metavar="NAME=VALUE",
            help="Of the store at URLs, as fsspec names it; repeatable.",
        ),
    ] = None,
    retry: Annotated[
        bool, typer.Option("--retry", help="Try logs again that could not be read.")
    ] = False,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Diagnose every log once, then all together: the course of each effect by machine, what
    products, operators and fields share, what it cost. Ctrl-C ends; what is done is kept."""
    from topdress.console.reports.html import GENERATOR_META
    from topdress.console.services.fleet import (
        FleetRequest,
        diagnose_fleet,
        find_logs,
        open_cluster,
    )
    from topdress.console.services.fleet_job import FORMAT
    from topdress.console.services.fleet_tables import TABLE_COLUMNS
    from topdress.drivers.files.config import calc_sha256, load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND
    from topdress.drivers.files.optional_packages import require_extras
    from topdress.drivers.files.run_meta import find_software_version

    # All extras are checked at once, so that the user installs them in one step.
    require_extras("a season of logs", "fleet", "diagnosis", "parquet")
    loaded = load_config(machine, MACHINE_KIND)
    options = _parse_store_options(storage or [])
    logs = find_logs(paths, out, options)
    if not logs:
        raise CommandError(f"{paths[0]}: no logs there: allowed are .csv and .parquet")
    table = None if about is None else Path(about)
    reads = [
        # URLs are never overwritten here, so only local files are compared with the outputs.
        *(Path(log) for log in logs if "://" not in log),
        loaded.path,
        *([] if table is None else [table]),
    ]
    tables = [out / f"{name}.parquet" for name in TABLE_COLUMNS]
    refuse_collisions(
        reads, [make_marked_output(out / REPORT_NAME, GENERATOR_META.encode(), tables)], force
    )
    known = None if table is None else _read_log_list(table, logs)
    out.mkdir(parents=True, exist_ok=True)
    # Records depend on program, format and machine file; a changed salt diagnoses every log again.
    salt = f"{FORMAT} {find_software_version()} {calc_sha256(loaded.path)} "
    # The monotonic clock is independent of a change of the computer's time.
    begin = time.monotonic()
    asked = FleetRequest(loaded.model.model_dump(mode="json"), salt, options, retry)
    # More workers than logs would only wait.
    with open_cluster(scheduler, min(workers, len(logs))) as client:
        try:
            found = diagnose_fleet(client, logs, asked, out, _make_progress())
        except KeyboardInterrupt:
            # A second Ctrl-C waits for no worker.
            # os._exit ends at once: Dask's own ending waits for its workers.
            signal.signal(signal.SIGINT, lambda *_: os._exit(EXIT_CANCELLED))
            typer.echo(
                f"\ncancelled: what is done is kept in {out}; the same command goes on", err=True
            )
            raise typer.Exit(EXIT_CANCELLED) from None
    took_s = time.monotonic() - begin
    _print_season(found, known.of if known else {}, out, price, currency, as_json)
    twins = f", {found.twins} the same as others" if found.twins else ""
    typer.echo(
        f"{len(logs)} logs, {len(found.records)} diagnosed ({found.known} before), "
        f"{len(found.broken)} broken"
        f"{twins}; {took_s:.0f} s",
        err=True,
    )
    # A season without one diagnosed log is an error for a script that expects a report.
    if not found.records:
        raise CommandError(
            f"{out}: no log was diagnosed: allowed is a run with at least one that can be read"
        )


def _parse_store_options(said: list[str]) -> dict[str, str]:
    """Returns NAME=VALUE options as fsspec takes them."""
    for one in said:
        # The value may be empty or contain "="; only the name is required.
        if not one.partition("=")[0] or "=" not in one:
            raise CommandError(f"--storage-option {one}: allowed is NAME=VALUE, as anon=true")
    return {name: value for name, _equals, value in (one.partition("=") for one in said)}


def _print_season(
    found: FleetFindings,
    rows: Mapping[str, Mapping[str, str]],
    out: Path,
    price: float | None,
    currency: str,
    as_json: bool,
) -> None:
    from topdress.console.reports.fleet_page import (
        describe_costliest,
        describe_left_out,
        describe_low_hopper,
        describe_same,
        describe_shared,
        make_fleet_page,
    )
    from topdress.console.services.fleet_metadata import apply_list_row
    from topdress.console.services.fleet_season import make_season
    from topdress.console.services.fleet_tables import write_tables
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.run_meta import find_software_version

    for line in (*found.blind, *found.gone):
        # Progress and faults go to stderr, so that stdout holds the result.
        typer.echo(line, err=True)
    for path, why in found.broken:
        typer.echo(f"broken: {why}" if path in why else f"broken: {path}: {why}", err=True)
    # The list's rows are applied to kept records too, so a corrected list needs no new diagnosis.
    records = [apply_list_row(one, rows.get(one["path"], {})) for one in found.records]
    # A clock later than today marks a log whose time is wrong; days since 1970.
    whole = make_season(records, found.broken, day_clock.read_epoch_s() / 86_400.0)
    write_tables(out, whole, records)
    page = make_fleet_page(
        whole.machines,
        whole.fit,
        low=whole.low,
        units=whole.units,
        broken=whole.broken,
        price=price,
        currency=currency,
        software=f"topdress {find_software_version()}",
        aside=whole.aside,
        by_file_date=whole.by_file_date,
    )
    write_atomically(out / REPORT_NAME, page)
    if as_json:
        # The logs themselves are in the Parquet tables and would make the JSON very long.
        print_json(whole._replace(logs=()))
        return
    for one in whole.machines:
        typer.echo(
            f"{one.machine:20} {one.wrong_kg:9.1f} of {one.applied_kg:9.1f} kg  now "
            f"{one.now_percent:+5.1f} %"
            f"  {describe_costliest(one)}"
        )
    fit = whole.fit
    shared = (describe_shared(one, whole.units) for one in fit.shared)
    for said in (
        *map(describe_left_out, whole.aside),
        *shared,
        *map(describe_same, fit.same),
        *map(describe_low_hopper, whole.low),
    ):
        typer.echo(said)
    typer.echo(f"report: {out / REPORT_NAME}", err=True)


def _read_log_list(table: Path, logs: list[str]) -> ListedLogs:
    """Returns the list's rows by log. Missing columns, and rows without a log, are printed here."""
    from topdress.console.services.fleet_metadata import LIST_COLUMNS, match_rows
    from topdress.drivers.files.table import read_table

    read = read_table(table, texts=LIST_COLUMNS)
    # A misspelt column would otherwise be ignored in silence.
    strange = [name for name in read.names if name not in LIST_COLUMNS]
    if "log" not in read.columns or strange:
        raise CommandError(
            f"{table}: column {(strange or ['log'])[0]}: allowed are {', '.join(LIST_COLUMNS)}; "
            "log must be "
            "there"
        )
    try:
        found = match_rows(
            [
                {name: str(column[k]) for name, column in read.columns.items()}
                for k in range(len(read.columns["log"]))
            ],
            logs,
        )
    except ValueError as error:
        raise CommandError(f"{table}: {error}") from None
    # A long list of rows without logs says no more than its beginning.
    for said in found.unused[:MAX_STRAY_ROWS]:
        typer.echo(f"{table}: {said}", err=True)
    typer.echo(
        f"{table}: {len(found.of)} of {len(logs)} logs have a row, {found.silent} have none; "
        f"{len(found.unused)} rows are of no log",
        err=True,
    )
    if not found.of:
        raise CommandError(
            f"{table}: no row is of a log: allowed in column log is how the path of one log "
            "ends, as "
            f"{'/'.join(logs[0].split('/')[-2:])}"
        )
    return found


def _make_progress(clock: Callable[[], float] = time.monotonic) -> Callable[[int, int, str], None]:
    """Returns a function that shows progress: a line that is rewritten on a terminal, elsewhere a
    line from time to time."""
    # The clock is a parameter, so that a test needs no waiting.
    line, said_s = ProgressLine(), [clock()]

    def show_count(done: int, of: int, what: str) -> None:
        if not line.shown:
            if done < of and clock() - said_s[0] >= PROGRESS_PERIOD_S:
                said_s[0] = clock()
                typer.echo(f"{done} of {of} {what}", err=True)
        elif done >= of:
            line.clear_line()
        else:
            line.show_text(f"{done} of {of} {what} (Ctrl-C cancels)")

    return show_count

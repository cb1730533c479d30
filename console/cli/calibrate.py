"""`topdress calibrate`: bench tables to a new machine file; the old one stays as it is."""
from __future__ import annotations

import datetime as dt
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from console.cli.plain_errors import CommandError

if TYPE_CHECKING:
    from control.calibration.flow_fit import FlowFit
    from control.calibration.lag_fit import LagFit
    from control.calibration.least_squares import Interval


class What(StrEnum):
    CATCH = "catch"
    LAG = "lag"


def calibrate(
    what: Annotated[What, typer.Argument(help="catch: flow model; lag: drop times.")],
    data: Annotated[Path | None, typer.Argument(metavar="[DATA.csv]", help="The bench table.")] = None,
    *,
    out: Annotated[Path, typer.Option(metavar="NEW.yaml|TABLE.csv", help="The new machine file; with --rig the new "
                                      "bench table.")],
    machine: Annotated[str, typer.Option(help="Machine file to begin with, or name of a shipped one.")] = "huanghai",
    label: Annotated[str | None, typer.Option(help="lag: only the rows with this label (e.g. detected).")] = None,
    from_rpm: Annotated[float | None, typer.Option(help="lag: lowest shaft speed used.")] = None,
    to_rpm: Annotated[float | None, typer.Option(help="lag: highest shaft speed used.")] = None,
    rig: Annotated[str | None, typer.Option(metavar="URL", help="lag: measure, with the lag rig there.")] = None,
    board: Annotated[str | None, typer.Option(metavar="URL", help="--rig: the board that turns the shaft.")] = None,
    gnss: Annotated[str | None, typer.Option(metavar="URL", help="--rig: the GNSS receiver, where fitted.")] = None,
    rpm: Annotated[list[float] | None, typer.Option(help="--rig: a shaft speed (repeatable); default 10 to 70 in steps "
                                                    "of 10.")] = None,
    repeats: Annotated[int, typer.Option(min=1, max=100, help="--rig: runs at each speed.")] = 10,
    opening_mm: Annotated[float | None, typer.Option(help="--rig: opening of the gate; default: as it stands.")] = None,
    no_key: Annotated[bool, typer.Option("--no-key", help="--rig: turn without a held key; somebody stands beside the "
                                         "hard-wired stop.")] = False,
) -> None:
    """Fit the flow or the lag model to a bench table, with intervals and the range in which it holds.

    With lag --rig URL --board URL: measure a lag bench table.
    """
    if rig is not None and what is What.LAG and data is None:
        from console.cli.lag_rig import measure_lag
        measure_lag(rig, board, gnss, machine, out, rpm or (), repeats, opening_mm, no_key)
        return
    if data is None or rig is not None:
        raise CommandError("calibrate: allowed is a bench table, or lag with --rig URL and no table")
    from control.calibration.flow_fit import fit_flow
    from control.calibration.lag_fit import fit_lag
    from drivers.files.bench_table import read_bench_table
    from drivers.files.config import load, save
    from drivers.files.kinds import MACHINE
    if out.exists():
        raise CommandError(f"{out}: exists already: nothing is overwritten")
    loaded = load(machine, MACHINE).model
    table = read_bench_table(data, what.value)
    today = dt.date.today().isoformat()
    if what is What.CATCH:
        fitted, flow = fit_flow(table, loaded, date=today)
        _tell_flow(flow)
    else:
        fitted, line = fit_lag(table, loaded, label=label, from_rpm=from_rpm, to_rpm=to_rpm, date=today)
        _tell_lag(line)
    save(out, fitted, MACHINE)
    typer.echo(f"machine file: {out}")


def _tell_flow(fit: FlowFit) -> None:
    typer.echo(f"{fit.rows_used} catches, {fit.shaft_rpm[0]:g}-{fit.shaft_rpm[1]:g} r/min, "
               f"{fit.opening_mm[0]:g}-{fit.opening_mm[1]:g} mm, scatter {fit.residual_sd_percent:.2f} %")
    typer.echo(f"grams per revolution and mm  {_span(fit.grams_per_rev_mm)}")
    if fit.zero_offset_g_rev is not None:
        typer.echo(f"grams per revolution at zero opening  {_span(fit.zero_offset_g_rev)}")
    if fit.fill_falloff_percent is not None:
        typer.echo(f"lost at 100 r/min, %  {_span(fit.fill_falloff_percent)}")
    for note in fit.notes:
        typer.echo(f"note: {note}")


def _tell_lag(fit: LagFit) -> None:
    typer.echo(f"{fit.measured}: {fit.rows_used} rows, {fit.from_rpm:g}-{fit.to_rpm:g} r/min, scatter "
               f"{fit.residual_sd_s:.4f} s, correlation {fit.correlation:.3f}")
    typer.echo(f"slope, s per r/min  {_span(fit.slope_s_per_rpm)}")
    typer.echo(f"intercept, s        {_span(fit.intercept_s)}")
    for note in fit.notes:
        typer.echo(f"note: {note}")


def _span(one: Interval) -> str:
    return f"{one.value:.5g} (90 %: {one.low:.5g} to {one.high:.5g})"

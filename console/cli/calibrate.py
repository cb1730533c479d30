"""How does `topdress calibrate` make a new machine file from bench tables and run logs? The old
file stays unchanged.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.inputs import (
    RUN_LOG_KINDS,
    TABLE_FILE_KINDS,
    load_machine,
    refuse_bench_table,
    refuse_other_kinds,
    refuse_run_log,
    require_suffix,
)
from topdress.console.cli.outputs import (
    ForceOption,
    Output,
    find_machine_file,
    list_log_files,
    refuse_collisions,
)
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.drivers import day_clock

# Type checking only: numpy and the fits load in the commands that use them, so `topdress --help`
# stays quick.
if TYPE_CHECKING:
    from topdress.control.calibration.flow_fit import FlowFit
    from topdress.control.calibration.heads_check import HeadsFit
    from topdress.control.calibration.lag_fit import LagFit
    from topdress.control.calibration.least_squares import FittedInterval
    from topdress.control.calibration.tube_fit import TubeFit
    from topdress.control.calibration.wheel_fit import WheelFit
    from topdress.control.diagnosis.runs.effort_reference import EffortFit
    from topdress.control.machine.machine import Machine


TableArgument = Annotated[Path, typer.Argument(metavar="TABLE.csv", help="The bench table.")]
LogArgument = Annotated[Path, typer.Argument(metavar="LOG.csv", help="A run log.")]
OutOption = Annotated[Path, typer.Option(metavar="NEW.yaml", help="The new machine file.")]
FromOption = Annotated[
    str,
    typer.Option(metavar="MACHINE", help="Machine file to begin with, or name of a shipped one."),
]
DateOption = Annotated[
    str | None, typer.Option(metavar="YYYY-MM-DD", help="Of the test; default: today.")
]


def calibrate_catch(
    data: TableArgument,
    *,
    out: Annotated[
        Path,
        typer.Option(
            metavar="NEW.yaml", help="The new machine file; with --product the new product file."
        ),
    ],
    machine: FromOption = "huanghai",
    product: Annotated[
        str | None,
        typer.Option(
            metavar="PRODUCT",
            help="What was caught: the test is added, with its "
            "date, to this product file instead of the machine's.",
        ),
    ] = None,
    date: DateOption = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Fit the flow model to a catch test: what was weighed at each shaft speed and opening,
    with intervals."""
    from topdress.control.calibration.flow_fit import fit_flow
    from topdress.drivers.files.bench_table import read_bench_table

    # All checks precede the fit, so that no minute of work ends in an output that cannot be
    # written.
    _refuse_no_table(data, out, "calibrate catch")
    loaded = _load_first_machine(data, out, machine, force)
    day = _parse_date(date)
    fitted, flow = fit_flow(read_bench_table(data, "catch"), loaded, date=day.isoformat())
    # The printed table is made only in the text form; `--json` prints the fit's fields instead.
    _print_fit(flow, lambda: _print_flow_fit(flow, loaded), as_json)
    if product is None:
        _save_machine(fitted, data, out, as_json)
    else:
        _save_product_test(product, loaded, flow, day, data, out, as_json)


def _parse_date(text: str | None) -> dt.date:
    try:
        # The date is stored in the records as a word in ISO form: a file with it reads alike in
        # every locale.
        return day_clock.read_today() if text is None else dt.date.fromisoformat(text)
    except ValueError:
        raise CommandError(f"--date {text}: allowed is a day such as 2026-03-18") from None


def _save_product_test(
    product: str,
    machine: Machine,
    flow: FlowFit,
    day: dt.date,
    data: Path,
    out: Path,
    as_json: bool,
) -> None:
    """Writes the product with this test added to its earlier tests."""
    from topdress.control.calibration.flow_fit import make_catch_test
    from topdress.drivers.files.config import calc_sha256, load_config, save_config
    from topdress.drivers.files.config_kinds import PRODUCT_KIND

    read = load_config(product, PRODUCT_KIND)
    # The old file stays as evidence of the earlier test; a new file must not replace it in place.
    if read.path.resolve() == out.resolve():
        raise CommandError(f"--out {out}: is the product file that is read: allowed is a new name")
    save_config(
        out,
        # The checksum of the table goes into the record, so that a later reader can verify the data
        # of this test.
        read.model.append_test(make_catch_test(machine, flow, day, str(data), calc_sha256(data))),
        PRODUCT_KIND,
    )
    # The remark goes to stderr with --json, so that stdout holds JSON only.
    typer.echo(f"product file: {out}", err=as_json)


def calibrate_lag(
    data: Annotated[
        Path | None, typer.Argument(metavar="[TABLE.csv]", help="The bench table; none with --rig.")
    ] = None,
    *,
    out: Annotated[
        Path,
        typer.Option(
            metavar="NEW.yaml|TABLE.csv",
            help="The new machine file; with --rig the new bench table.",
        ),
    ],
    machine: FromOption = "huanghai",
    label: Annotated[
        str | None,
        typer.Option(metavar="WORD", help="Only the rows with this label (e.g. detected)."),
    ] = None,
    from_rpm: Annotated[
        float | None, typer.Option(metavar="RPM", help="Lowest shaft speed used.")
    ] = None,
    to_rpm: Annotated[
        float | None, typer.Option(metavar="RPM", help="Highest shaft speed used.")
    ] = None,
    rig: Annotated[
        str | None, typer.Option(metavar="URL", help="Measure, with the lag rig there.")
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="--rig: the board that turns the shaft; none: turned by hand, drop times only.",
        ),
    ] = None,
    gnss: Annotated[
        str | None, typer.Option(metavar="URL", help="--rig: the GNSS receiver, where fitted.")
    ] = None,
    rpm: Annotated[
        list[float] | None,
        typer.Option(
            metavar="RPM",
            help="--rig: a shaft speed (repeatable); default 10 to 70 in steps of 10.",
        ),
    ] = None,
    repeats: Annotated[
        int, typer.Option(metavar="NUMBER", min=1, max=100, help="--rig: runs at each speed.")
    ] = 10,
    opening_mm: Annotated[
        float | None,
        typer.Option(metavar="MM", help="--rig: opening of the gate; default: as it stands."),
    ] = None,
    no_key: Annotated[
        bool,
        typer.Option(
            "--no-key",
            help="--rig: turn without a held key; somebody stands at the hard-wired stop.",
        ),
    ] = False,
    date: DateOption = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Fit the lag to drop times at several shaft speeds, or measure such a table with the lag
    rig."""
    # The lag rig measures the table itself; serial drivers load only for it.
    if rig is not None and data is None:
        from topdress.console.cli.lag_rig import measure_lag

        # The rig writes a bench table and no machine file, so the output has another suffix than in
        # a fit.
        require_suffix("--out", out, ".csv")
        _refuse_overwriting((), out, machine, force)
        measure_lag(
            rig,
            board,
            gnss,
            machine=machine,
            out=out,
            speeds_rpm=rpm or (),
            repeats=repeats,
            opening_mm=opening_mm,
            no_key=no_key,
        )
        return
    if data is None or rig is not None:
        raise CommandError("calibrate lag: allowed is a bench table, or --rig URL and no table")
    from topdress.control.calibration.lag_fit import fit_lag
    from topdress.control.calibration.tube_fit import settle_tube
    from topdress.drivers.files.bench_table import read_bench_table

    _refuse_no_table(data, out, "calibrate lag")
    fitted, day = _load_first_machine(data, out, machine, force), _parse_date(date).isoformat()
    table = read_bench_table(data, "lag")
    running = table.find_running_rows()
    # A table can contain starts (shaft from rest), changes between two speeds, or both; each kind
    # determines other parameters.
    line, tube = None, None
    if not running.all():
        fitted, line = fit_lag(
            table, fitted, label=label, from_rpm=from_rpm, to_rpm=to_rpm, date=day
        )
    # The tube is fitted after the lag, because it uses the machine with the fitted lag.
    if running.any():
        fitted, tube = settle_tube(table, fitted, date=day)
    _print_fit(
        {"lag": line, "tube": tube},
        lambda: _print_lag_fit(line, tube, fitted.is_tube_measured),
        as_json,
    )
    _save_machine(fitted, data, out, as_json)


def calibrate_wheel(
    data: LogArgument,
    *,
    out: OutOption,
    machine: FromOption = "huanghai",
    date: DateOption = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Fit the wheel's circumference to GNSS distances of a run log."""
    from topdress.control.calibration.wheel_fit import fit_wheel
    from topdress.drivers.files.calibration_log import find_wheel_circumference, read_wheel_log
    from topdress.drivers.files.read_log import read_nonempty_log

    _refuse_no_log(data, out, "calibrate wheel")
    # The log's own circumference is needed: its wheel distances were computed with this value.
    loaded, log = _load_first_machine(data, out, machine, force), read_nonempty_log(data)
    fitted, found = fit_wheel(
        read_wheel_log(log),
        loaded,
        find_wheel_circumference(log, loaded),
        str(data),
        date=_parse_date(date).isoformat(),
    )
    _print_fit(found, lambda: _print_wheel_fit(found), as_json)
    _save_machine(fitted, data, out, as_json)


def calibrate_heads(
    data: LogArgument,
    *,
    out: OutOption,
    machine: FromOption = "huanghai",
    date: DateOption = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Fit each canopy head against the others over a run log."""
    from topdress.control.calibration.heads_check import check_heads
    from topdress.drivers.files.calibration_log import read_head_columns
    from topdress.drivers.files.read_log import read_nonempty_log

    _refuse_no_log(data, out, "calibrate heads")
    loaded, log = _load_first_machine(data, out, machine, force), read_nonempty_log(data)
    fitted, found = check_heads(
        log.time_s, read_head_columns(log), loaded, str(data), date=_parse_date(date).isoformat()
    )
    _print_fit(found, lambda: _print_heads_fit(found), as_json)
    _save_machine(fitted, data, out, as_json)


class EffortUnit(StrEnum):
    """Lists the units of `effort_unit` in the machine file."""

    # The values are those of the key `effort_unit`, not words of the screen; they must not be
    # translated.
    DUTY = "%"
    CURRENT = "A"
    TORQUE = "N m"


def calibrate_effort(
    data: LogArgument,
    *,
    out: OutOption,
    machine: FromOption = "huanghai",
    unit: Annotated[
        EffortUnit | None, typer.Option(help="What the drives tell; default: the machine file's.")
    ] = None,
    date: DateOption = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Fit how hard the drives of a sound machine work to a run log: what later logs are held
    against."""
    from topdress.control.diagnosis.runs.effort_reference import fit_effort
    from topdress.drivers.files.any_log import open_any_log

    _refuse_no_log(data, out, "calibrate effort")
    loaded = _load_first_machine(data, out, machine, force)
    fitted, found = fit_effort(
        # open_any_log also reads logs of other programs, since the effort of a drive can come from
        # any recorder.
        dict(open_any_log(data).columns),
        loaded,
        str(data),
        date=_parse_date(date).isoformat(),
        unit=None if unit is None else unit.value,
    )
    _print_fit(found, lambda: _print_effort_fits(found), as_json)
    _save_machine(fitted, data, out, as_json)


def calibrate_encoder(
    *,
    board: Annotated[str, typer.Option(metavar="URL", help="The slave board.")],
    out: Annotated[
        Path,
        typer.Option(metavar="SETTINGS.py", help="The new line of the board's board_settings.py."),
    ],
    turns: Annotated[
        int, typer.Option(metavar="NUMBER", min=1, max=1000, help="Whole turns of the shaft a run.")
    ] = 10,
    repeats: Annotated[
        int,
        typer.Option(
            metavar="NUMBER", min=1, max=20, help="Runs; their scatter gives the interval."
        ),
    ] = 3,
    rpm: Annotated[
        float | None,
        typer.Option(
            metavar="RPM",
            help="The drive turns the shaft, at "
            "this speed and while the space bar is held; default: by hand, nothing "
            "that turns is sent.",
        ),
    ] = None,
    machine: Annotated[
        str, typer.Option(metavar="MACHINE", help="--rpm: whose limits hold.")
    ] = "huanghai",
    force: ForceOption = False,
) -> None:
    """Count the encoder's pulses over whole turns of the metering shaft, for the board's
    settings."""
    from topdress.console.cli.encoder import count_encoder

    require_suffix("--out", out, ".py")
    _refuse_overwriting((), out, machine, force)
    limits = load_machine(machine).limits
    # The limit is tested before the board is opened: a typed speed beyond the limits must never
    # reach the drive.
    if rpm is not None and not limits.shaft_low_rpm <= rpm <= limits.shaft_high_rpm:
        raise CommandError(
            f"--rpm {rpm:g}: allowed is {limits.shaft_low_rpm:g} to {limits.shaft_high_rpm:g}, the "
            f"limits of {machine}"
        )
    count_encoder(board, turns=turns, repeats=repeats, rpm=rpm, machine=machine, out=out)


def _refuse_no_table(data: Path, out: Path, command: str) -> None:
    """Raises WrongKindError for a file that is no bench table, CommandError for an output without
    the suffix of a machine file."""
    refuse_other_kinds([data], TABLE_FILE_KINDS)
    # A run log is a CSV file too; without this check its columns would be reported as missing
    # columns of a bench table.
    refuse_run_log(data, command)
    require_suffix("--out", out, ".yaml", ".yml")


def _refuse_no_log(data: Path, out: Path, command: str) -> None:
    """Raises WrongKindError for a file that is no run log, CommandError for an output without the
    suffix of a machine file."""
    refuse_other_kinds([data], RUN_LOG_KINDS)
    # A bench table would be read as a log without time_s; the message names the right command
    # instead.
    refuse_bench_table(data, command)
    require_suffix("--out", out, ".yaml", ".yml")


def _refuse_overwriting(reads: Iterable[Path], out: Path, machine: str, force: bool) -> None:
    # The machine file that is read counts as an input, so `--out` cannot overwrite it.
    refuse_collisions((*reads, find_machine_file(machine)), [Output((out,))], force)


def _load_first_machine(data: Path, out: Path, machine: str, force: bool) -> Machine:
    _refuse_overwriting(list_log_files(data), out, machine, force)
    return load_machine(machine)


def _save_machine(fitted: Machine, data: Path, out: Path, as_json: bool) -> None:
    from topdress.drivers.files.config import save_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    # The checksum is added here and not in the fit: the package control reads no files.
    save_config(out, _sign_records(fitted, data), MACHINE_KIND)
    typer.echo(f"machine file: {out}", err=as_json)


def _print_fit(found: object, tell: Callable[[], None], as_json: bool) -> None:
    """Prints a fit, as data or in lines."""
    if as_json:
        print_json(found)
    else:
        tell()


# A start has no earlier flow in the tube, hence it cannot show how the flow changes there.
TUBE_UNSETTLED = (
    "starts do not show whether the stream in the tube carries what falls; a step from 40 "
    "to 80 r/min at the "
    "rig, ten times, does (before_rpm in the table): docs/field-work.md"
)


def _sign_records(machine: Machine, data: Path) -> Machine:
    """Returns the machine with the checksum of the data in the records of this calibration."""
    from topdress.drivers.files.config import calc_sha256

    checksum = calc_sha256(data)
    return machine.model_copy(
        update={
            "adopted": tuple(
                record.model_copy(update={"sha256": checksum})
                # Records of earlier calibrations keep their own data and checksum.
                if record.data == str(data)
                else record
                for record in machine.adopted
            )
        }
    )


def _print_wheel_fit(fit: WheelFit) -> None:
    typer.echo(
        f"{fit.stretches} straight stretches, {fit.way_m:.0f} m "
        f"{'at work' if fit.at_work else 'without flow'}"
    )
    typer.echo(f"wheel circumference, m  {_format_interval(fit.circumference_m)}")
    # Slip exists only where the log has both stretches at work and stretches without flow.
    if fit.slip_percent is not None:
        typer.echo(f"slip at work, %  {_format_interval(fit.slip_percent)}")
    _print_notes(fit.notes)


def _print_heads_fit(fit: HeadsFit) -> None:
    for head in fit.heads:
        # A head without a line has too few samples with the others, so only its deviation is
        # printed.
        line = "" if head.slope is None else f", line {head.slope:.3f} x others {head.offset:+.3f}"
        typer.echo(
            f"head {head.number}  off by {_format_interval(head.gain_percent)} "
            f"%{line}{'  FOULED' if head.fouled else ''}"
        )
    _print_notes(fit.notes)


def _print_effort_fits(found: Iterable[EffortFit]) -> None:
    for fit in found:
        typer.echo(
            f"{fit.bins} half seconds of moving, {fit.mean:.4g} {fit.unit} on the mean, scatter "
            f"{fit.scatter:.3g} {fit.unit}"
        )
        for place, interval, unit in fit.numbers:
            typer.echo(f"{place}, {unit}  {_format_interval(interval)}")
        _print_notes(fit.notes)


def _print_flow_fit(fit: FlowFit, machine: Machine) -> None:
    typer.echo(
        f"{fit.rows_used} catches, {fit.shaft_rpm[0]:g}-{fit.shaft_rpm[1]:g} r/min, "
        f"{fit.opening_mm[0]:g}-{fit.opening_mm[1]:g} mm, scatter {fit.residual_sd_percent:.2f} %"
    )
    typer.echo(f"grams per revolution and mm  {_format_interval(fit.grams_per_rev_mm)}")
    # The offset and the falloff are fitted only if the table varies opening and speed enough.
    if fit.zero_offset_g_rev is not None:
        typer.echo(
            f"grams per revolution at zero opening  {_format_interval(fit.zero_offset_g_rev)}"
        )
    if fit.fill_falloff_percent is not None:
        typer.echo(
            f"lost at {machine.flow.full_rpm:g} r/min, %  "
            f"{_format_interval(fit.fill_falloff_percent)}"
        )
    _print_notes(fit.notes)


def _print_lag_fit(line: LagFit | None, tube: TubeFit | None, is_tube_measured: bool) -> None:
    if line is not None:
        typer.echo(
            f"{line.measured}: {line.rows_used} rows, {line.from_rpm:g}-{line.to_rpm:g} "
            "r/min, scatter "
            f"{line.residual_sd_s:.4f} s, correlation {line.correlation:.3f}"
        )
        typer.echo(f"slope, s per r/min  {_format_interval(line.slope_s_per_rpm)}")
        typer.echo(f"intercept, s        {_format_interval(line.intercept_s)}")
        _print_notes(line.notes)
    if tube is not None:
        typer.echo(
            f"tube: {tube.rows_used} changes between two rates, scatter {tube.scatter_s:.4f} s, "
            f"{tube.off_s:+.3f} s off the nearest tube"
        )
        typer.echo(
            f"share that the stream carries  {_format_interval(tube.carried_share)}, s.d. "
            f"{tube.sd:.2f}"
        )
        # An interval that is too wide changes no setting: control then computes without a tube.
        if not tube.settles:
            typer.echo(
                "note: not settled yet, more repeats are needed: until then no strategy "
                "counts on the tube"
            )
    elif not is_tube_measured:
        typer.echo(f"note: {TUBE_UNSETTLED}")


def _print_notes(notes: Iterable[str]) -> None:
    for note in notes:
        typer.echo(f"note: {note}")


def _format_interval(one: FittedInterval) -> str:
    # Five significant digits exceed the precision of each fit, so rounding never hides a
    # difference.
    return f"{one.value:.5g} (90 %: {one.low:.5g} to {one.high:.5g})"

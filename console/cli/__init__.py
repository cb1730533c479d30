"""How is the command line `topdress` built? Each command has a file of its own, which is imported
only when it is requested; slow modules are imported when it runs.

Files:

- `bench_session`: How does a person at the bench turn the shaft?
- `calibrate`: How does `topdress calibrate` make a new machine file from bench tables and run logs?
- `check`: How does `topdress check` report errors of configuration files
- `check_range`: Which rates of a job can a machine not apply at the job's speeds?
- `compare`: How does `topdress compare` show the errors of two machine files on logs to which
- `decode`: How does `topdress decode` read a raw capture through its real driver?
- `devices`: How does `topdress devices` list ports and the devices on them?
- `diagnose`: How does `topdress diagnose` show the errors of the machine model on measured data
- `drop_test`: How does `topdress calibrate lag --rig URL` work without a board?
- `effects`: How does `topdress effects` list the catalogue?
- `encoder`: How does `topdress calibrate encoder --board URL` count pulses per turn of the
- `field`: How does `topdress field` convert outlines
- `fleet`: How does `topdress fleet` diagnose a season of logs of many machines
- `history`: How does `topdress history` show the changes of a machine file by diagnoses
- `import_log`: How does `topdress import` convert the log of any machine to a run log
- `info`: How do `topdress info` and `topdress extras` list the installation
- `inputs`: Which kinds of files and suffixes does a command accept?
- `lag_rig`: How does `topdress calibrate lag --rig URL` run the lag test on real devices and write
- `line_output`: How are lines written to standard output without waiting for their reader?
- `live`: How does `topdress live` publish the state of the machine as lines of JSON on stdout
- `machine`: How does `topdress machine --from LOG` make a first machine file of one stage?
- `map`: How does `topdress map` read, summarise and convert prescriptions
- `outputs`: Which files will a command write?
- `plain_errors`: How do commands report errors?
- `plain_output`: What commands say: on a terminal or to a pipe
- `progress`: How does a command show its progress and the remaining time?
- `record`: How does `topdress record` write passes as lines of a farm record
- `replay`: How does `topdress replay` show a run log on the screen
- `reproduce`: How does `topdress reproduce` show the papers' tables and figures
- `run`: How does `topdress run` open the console on a running or newly started control worker?
- `screens`: How does the command line open the screens?
- `serve`: How does `topdress serve` show the console in a browser
- `serve_machine`: How does `topdress serve-machine` provide the virtual machine for the real
- `simulate`: How does `topdress simulate` run the closed loop on the machine model
- `tablet`: How does one tab of `topdress serve` run?
- `terms`: How is a term of `--term` parsed, and how are terms explained in words?
- `trial`: How does `topdress trial` show plots on one page, with applied amounts
- `watch`: How does `topdress watch` compare a growing log with the machine model while the machine
- `whole_log`: How does a computed run log get its name only when it is complete?
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import Annotated, Any

import typer
from topdress.console.cli.plain_errors import guard_command
from topdress.console.cli.plain_output import replace_streams
from topdress.console.thread_limits import limit_matrix_threads
from typer.core import TyperCommand

# Examples below each command's help. A test parses every example.
EXAMPLES: dict[str, tuple[str, ...]] = {
    "run": (
        "topdress run",
        "topdress run --config job.yaml --config cab.yaml",
        "topdress run --effect shaft.gain=-6",
    ),
    "replay": (
        "topdress replay run.csv",
        "topdress replay run.csv --headless --out again.csv --strategy speed_first",
    ),
    "simulate": (
        "topdress simulate --summary",
        "topdress simulate --seconds 3600 --out run.csv --effect shaft.gain=-6",
    ),
    "diagnose": (
        "topdress diagnose run.csv",
        "topdress diagnose run.csv --report why.html --adopt mended.yaml",
        "topdress diagnose lag.csv catch.csv --machine huanghai",
    ),
    "compare": (
        "topdress compare huanghai mended.yaml other-day.csv",
        "topdress compare old.yaml new.yaml a.csv b.csv --report compared.html",
    ),
    "watch": ("topdress watch run.csv", "topdress watch planter.csv --machine planter --to-end"),
    "fleet": (
        "topdress fleet season --out report --price 2.8",
        "topdress fleet s3://farm/logs/*.parquet --out report --scheduler tcp://barn:8786",
    ),
    "history": (
        "topdress history mended.yaml",
        "topdress history mended.yaml --undo --out before.yaml",
    ),
    "machine": (
        "topdress machine --from pump.csv --out my-pump.yaml --kind pump",
        "topdress machine --from wheel.csv --out left.yaml --full-speed 650 --both-ways "
        "--noise 2 --running",
    ),
    "calibrate catch": ("topdress calibrate catch weighed.csv --out mine.yaml",),
    "calibrate lag": (
        "topdress calibrate lag drops.csv --out mine.yaml --from-rpm 20 --to-rpm 60",
        "topdress calibrate lag --rig COM5 --board COM4 --out drops.csv",
    ),
    "calibrate wheel": ("topdress calibrate wheel run.csv --out mine.yaml",),
    "calibrate effort": ("topdress calibrate effort run.csv --out mine.yaml",),
    "calibrate heads": ("topdress calibrate heads run.csv --out mine.yaml",),
    "calibrate encoder": (
        "topdress calibrate encoder --board /dev/ttyACM0 --out board_settings.py",
        "topdress calibrate encoder --board COM4 --turns 20 --rpm 20 --out board_settings.py",
    ),
    "live": (
        "topdress live --port 4110",
        "topdress live --quiet --mqtt mqtt://cab@barn.local/farm/spreader --every 1",
    ),
    "info": ("topdress info", "topdress info --json"),
    "extras": ("topdress extras",),
    "effects": ("topdress effects", "topdress effects --json"),
    "decode": ("topdress decode gnss receiver.bin", "topdress decode board board.bin --json"),
    "import": (
        "topdress import yield.csv --guess --mapping yield.import.yaml",
        "topdress import yield.csv --mapping yield.import.yaml --out yield-log.csv",
    ),
    "map": (
        "topdress map field.shp",
        "topdress map field.shp --column RATE --unit lb/ac --out task.zip",
        "topdress map run.csv --out sheet.html",
    ),
    "field": (
        "topdress field ~/Documents/AgOpenGPS/Fields/North --job demo --out north.yaml",
        "topdress field north.kml --out north.geojson",
        "topdress field north.yaml --out north",
    ),
    "record": (
        "topdress record run.csv --out farm.csv",
        "topdress record *.csv --price urea=0.42 --currency EUR",
    ),
    "reproduce": ("topdress reproduce --out papers",),
    "trial": (
        "topdress trial plots.geojson run.csv weights.csv --out trial.html",
        "topdress trial plots.shp march.csv weights.csv --after april.csv --control CK "
        "--out trial.html",
    ),
    "check": ("topdress check job.yaml cab.yaml", "topdress check --schema machine"),
    "devices": ("topdress devices",),
    "serve": ("topdress serve",),
    "serve-machine": ("topdress serve-machine --port 4100",),
}
HELP_END = """Exit codes: 0 done; 1 a disk, port or line failed; 2 what was given is wrong;
3 nothing of the data could be judged; 70 a fault of topdress itself; 130 cancelled.
Words are completed by the tab key after: topdress --install-completion."""


def format_examples(name: str) -> str:
    """Returns the text below a command's help, with each example on a line of its own."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in EXAMPLES[name])


# The help uses words: an argument's name describes it, ranges are written out, and types and
# symbols of Python are removed.
# The pattern takes the blanks behind the type too, because they align the column of descriptions.
_TYPE_PATTERN = re.compile(r"^(  .*?)( <(?:str|int|float|path|list\[\w+\])>)( *)", re.MULTILINE)
_NUMBER_PATTERN = r"-?[\d.]+(?:e[-+]?\d+)?"
_RANGE_PATTERN = re.compile(
    rf"(?P<low>{_NUMBER_PATTERN})<=x<=(?P<high>{_NUMBER_PATTERN})|x>=(?P<least>{_NUMBER_PATTERN})|x<=(?P<most>{_NUMBER_PATTERN})"
)


def describe_ranges(text: str) -> str:
    """Returns `1<=x<=100` as from 1 to 100, `x>=0.0` as 0 or more, `x<=9` as at most 9."""

    def describe_range(found: re.Match[str]) -> str:
        number = {
            name: value.removesuffix(".0")
            for name, value in found.groupdict().items()
            if value is not None
        }
        if "low" in number:
            return f"from {number['low']} to {number['high']}"
        return f"{number['least']} or more" if "least" in number else f"at most {number['most']}"

    return _RANGE_PATTERN.sub(describe_range, text)


class PlainCommand(TyperCommand):
    """Prints its help in words: without types, ranges as words."""

    def get_help(self, ctx: Any) -> str:
        """Returns the help; removed types leave blanks, so that the following texts stay in their
        column."""
        said = _TYPE_PATTERN.sub(
            lambda found: found[1] + " " * len(found[2]) + found[3] if found[3] else found[1],
            super().get_help(ctx),
        )
        return describe_ranges(said)


def _make_typer_app() -> typer.Typer:
    return typer.Typer(
        name="topdress",
        # Without a command the console opens; typer would otherwise print its help.
        no_args_is_help=False,
        # Plain text stays readable in a pipe and needs no rich, which takes time to load.
        rich_markup_mode=None,
        # Tracebacks of typer show local values; faults are reported by plain_errors in one line.
        pretty_exceptions_enable=False,
        epilog=HELP_END,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
    )


# Commands by name, with their file in this folder and their function.
# The places are texts, so that no command's module is imported before it runs.
COMMAND_FUNCTIONS = {
    "run": "run.run_console",
    "replay": "replay.replay_log",
    "simulate": "simulate.run_simulation",
    "diagnose": "diagnose.run_diagnose",
    "compare": "compare.compare_machines",
    "watch": "watch.watch_log",
    "fleet": "fleet.run_fleet",
    "history": "history.print_history",
    "machine": "machine.make_machine_file",
    "effects": "effects.list_effects",
    "decode": "decode.decode_capture",
    "import": "import_log.run_import",
    "map": "map.convert_map",
    "field": "field.convert_field",
    "record": "record.record_passes",
    "trial": "trial.run_trial",
    "reproduce": "reproduce.reproduce_papers",
    "check": "check.check_files",
    "devices": "devices.list_devices",
    "serve": "serve.serve_tablets",
    "serve-machine": "serve_machine.serve_virtual_machine",
    "live": "live.publish_live",
    "info": "info.print_info",
    "extras": "info.list_extras",
}
CALIBRATION_FUNCTIONS = {
    name: f"calibrate.calibrate_{name}"
    for name in ("catch", "lag", "wheel", "heads", "effort", "encoder")
}


def run_main_command(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Terminal console of a variable-rate fertilizer applicator. Without a command: the console
    on the simulated machine."""
    if version:
        from topdress.drivers.files.run_meta import find_software_version

        typer.echo(f"topdress {find_software_version()}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        guard_command(_import_function(COMMAND_FUNCTIONS["run"]))()


def _import_function(place: str) -> Callable[..., None]:
    # The message of an import that fails names the module, so this is not caught here.
    file, _, name = place.partition(".")
    found: Callable[..., None] = getattr(import_module(f"topdress.console.cli.{file}"), name)
    return found


def _add_commands(commands: Mapping[str, str], to: typer.Typer, of: str = "") -> typer.Typer:
    for name, place in commands.items():
        to.command(name, cls=PlainCommand, epilog=format_examples(f"{of} {name}".strip()))(
            guard_command(_import_function(place))
        )
    return to


def _make_main_app() -> typer.Typer:
    app = _make_typer_app()
    app.callback(invoke_without_command=True)(run_main_command)
    return app


# Building every command takes time and is needed at most once.
@cache
def make_whole_app() -> typer.Typer:
    """Returns the app with every command, which is also `console.cli.app`."""
    app = _add_commands(COMMAND_FUNCTIONS, _make_main_app())
    calibrations = typer.Typer(
        rich_markup_mode=None,
        help="Fit flow or lag to a bench table, or wheel or heads to a run log; count a turn of "
        "the shaft.",
    )
    app.add_typer(
        _add_commands(CALIBRATION_FUNCTIONS, calibrations, "calibrate"),
        name="calibrate",
        no_args_is_help=True,
    )
    return app


# `console.cli.app` is made at its first use, since most runs need only one command.
def __getattr__(name: str) -> Any:
    if name == "app":
        return make_whole_app()
    raise AttributeError(name)


def make_requested_app(words: Sequence[str], environment: Mapping[str, str]) -> typer.Typer:
    """Returns the app with only the requested command.

    Importing and preparing all commands takes a tenth of the time to the first picture. General
    help, completion and unknown commands load the full app.
    """
    name = words[0] if words else "run"
    # Completion in a shell sets _TOPDRESS_COMPLETE and needs the names of all commands.
    if name not in COMMAND_FUNCTIONS or any(key.endswith("_COMPLETE") for key in environment):
        return make_whole_app()
    return _add_commands({name: COMMAND_FUNCTIONS[name]}, _make_main_app())


def main() -> None:
    """Runs the entry point `topdress`."""
    # Threads of the matrix library must be limited before numpy is imported.
    limit_matrix_threads()
    # Streams are replaced before any output, so that no text of a file can control the terminal.
    replace_streams()
    make_requested_app(sys.argv[1:], os.environ)()

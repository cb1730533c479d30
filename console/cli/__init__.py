"""The command line: `topdress --help`. Each command has a file of its own; what is heavy is imported when it runs."""
from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated

import typer

from console.cli import (
    calibrate,
    check,
    compare,
    decode,
    devices,
    diagnose,
    effects,
    fleet,
    history,
    import_log,
    replay,
    run,
    serve_machine,
    simulate,
    watch,
)
from console.cli import map as map_command
from console.cli import reproduce as reproduce_command
from console.cli import serve as serve_command
from console.cli.examples import ENDS, under
from console.cli.plain_errors import guarded
from console.cli.plain_help import PlainCommand
from console.cli.plain_output import take_terminals
from console.threads import few_for_matrices


def _app() -> typer.Typer:
    return typer.Typer(name="topdress", no_args_is_help=False, rich_markup_mode=None, pretty_exceptions_enable=False,
                       epilog=ENDS,
                       context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})


app = _app()
calibrations = typer.Typer(rich_markup_mode=None,
                           help="Fit flow or lag to a bench table, or wheel or heads to a run log.")


@app.callback(invoke_without_command=True)
def console(context: typer.Context,
            version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False) -> None:
    """Terminal console of a variable-rate fertilizer applicator. Without a command: the console on the simulated
    machine."""
    if version:
        from drivers.files.run_meta import software_version
        typer.echo(f"topdress {software_version()}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        guarded(run.run)()


def _add(to: typer.Typer, name: str, function: Callable[..., None], of: str = "") -> None:
    to.command(name, cls=PlainCommand, epilog=under(f"{of} {name}".strip()))(guarded(function))


_add(app, "run", run.run)
_add(app, "replay", replay.replay)
_add(app, "simulate", simulate.simulate)
_add(app, "diagnose", diagnose.diagnose)
_add(app, "compare", compare.compare)
_add(app, "watch", watch.watch)
_add(app, "fleet", fleet.fleet)
_add(app, "history", history.history)
app.add_typer(calibrations, name="calibrate", no_args_is_help=True)
_add(calibrations, "catch", calibrate.catch, "calibrate")
_add(calibrations, "lag", calibrate.lag, "calibrate")
_add(calibrations, "wheel", calibrate.wheel, "calibrate")
_add(calibrations, "heads", calibrate.heads, "calibrate")
_add(app, "effects", effects.effects)
_add(app, "decode", decode.decode)
_add(app, "import", import_log.import_log)
_add(app, "map", map_command.map_files)
_add(app, "reproduce", reproduce_command.reproduce)
_add(app, "check", check.check)
_add(app, "devices", devices.devices)
_add(app, "serve", serve_command.serve)
_add(app, "serve-machine", serve_machine.serve_machine)


def asked(words: Sequence[str], environment: Mapping[str, str]) -> typer.Typer:
    """The app with the one command that is asked for, where one is: to make all of them ready takes a tenth of the
    time to the first picture. Help of all, completion and slips of the pen get the whole."""
    name = words[0] if words else "run"
    found = [one for one in app.registered_commands if one.name == name]
    if not found or any(key.endswith("_COMPLETE") for key in environment):
        return app
    one = _app()
    one.registered_callback, one.registered_commands = app.registered_callback, found
    return one


def main() -> None:
    """The entry point `topdress`."""
    few_for_matrices()
    import control
    if not hasattr(control, "log_row") and _foreign(control.__doc__):
        typer.echo("another package (python-control) is installed over topdress's folder `control`: install topdress "
                   "in an environment of its own, e.g. with pipx or `uv tool install`", err=True)
        raise SystemExit(1)
    take_terminals()
    asked(sys.argv[1:], os.environ)()


def _foreign(doc: str | None) -> bool:
    return not (doc or "").startswith("What is decided and modelled.")

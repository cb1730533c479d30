"""The command line: `topdress --help`. Each command has a file of its own, imported where it is asked for; what is
heavy is imported when it runs."""
from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from console.cli.examples import ENDS, under
from console.cli.plain_errors import guarded
from console.cli.plain_help import PlainCommand
from console.cli.plain_output import take_terminals
from console.threads import few_for_matrices


def _app() -> typer.Typer:
    return typer.Typer(name="topdress", no_args_is_help=False, rich_markup_mode=None, pretty_exceptions_enable=False,
                       epilog=ENDS,
                       context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})


COMMANDS = {                    # by name: the file next to this one, and its function
    "run": "run.run", "replay": "replay.replay", "simulate": "simulate.simulate", "diagnose": "diagnose.diagnose",
    "compare": "compare.compare", "watch": "watch.watch", "fleet": "fleet.fleet", "history": "history.history",
    "machine": "machine.machine",
    "effects": "effects.effects", "decode": "decode.decode", "import": "import_log.import_log", "map": "map.map_files",
    "field": "field.field",
    "record": "record.record",
    "reproduce": "reproduce.reproduce", "check": "check.check", "devices": "devices.devices", "serve": "serve.serve",
    "serve-machine": "serve_machine.serve_machine", "info": "info.info", "extras": "info.extras"}
CALIBRATIONS = {name: f"calibrate.{name}" for name in ("catch", "lag", "wheel", "heads")}


def console(context: typer.Context,
            version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False) -> None:
    """Terminal console of a variable-rate fertilizer applicator. Without a command: the console on the simulated
    machine."""
    if version:
        from drivers.files.run_meta import software_version
        typer.echo(f"topdress {software_version()}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        guarded(_function(COMMANDS["run"]))()


def _function(place: str) -> Callable[..., None]:
    file, _, name = place.partition(".")
    found: Callable[..., None] = getattr(import_module(f"console.cli.{file}"), name)
    return found


def _with(commands: Mapping[str, str], to: typer.Typer, of: str = "") -> typer.Typer:
    for name, place in commands.items():
        to.command(name, cls=PlainCommand, epilog=under(f"{of} {name}".strip()))(guarded(_function(place)))
    return to


def _started() -> typer.Typer:
    app = _app()
    app.callback(invoke_without_command=True)(console)
    return app


@cache
def whole() -> typer.Typer:
    """The app with every command; `console.cli.app` is the same."""
    app = _with(COMMANDS, _started())
    calibrations = typer.Typer(rich_markup_mode=None,
                               help="Fit flow or lag to a bench table, or wheel or heads to a run log.")
    app.add_typer(_with(CALIBRATIONS, calibrations, "calibrate"), name="calibrate", no_args_is_help=True)
    return app


def __getattr__(name: str) -> Any:
    if name == "app":
        return whole()
    raise AttributeError(name)


def asked(words: Sequence[str], environment: Mapping[str, str]) -> typer.Typer:
    """The app with the one command that is asked for, where one is: to import all of them and to make them ready takes
    a tenth of the time to the first picture. Help of all, completion and unknown
    commands load the full app."""
    name = words[0] if words else "run"
    if name not in COMMANDS or any(key.endswith("_COMPLETE") for key in environment):
        return whole()
    return _with({name: COMMANDS[name]}, _started())


def main() -> None:
    """The entry point `topdress`."""
    few_for_matrices()
    import control
    own = " an environment of its own, e.g. by pipx or `uv tool install`"
    if not (control.__doc__ or "").startswith("What is decided and modelled."):
        typer.echo("topdress's folder `control` is not whole: another package of that name (python-control) came over "
                   f"it or was taken away with it: install topdress again, in{own}", err=True)
        raise SystemExit(1)
    if (Path(control.__file__ or "").parent / "xferfcn.py").exists():
        typer.echo("note: python-control lies in the same folder `control` as topdress and no longer works there: give "
                   f"topdress{own}", err=True)
    take_terminals()
    asked(sys.argv[1:], os.environ)()

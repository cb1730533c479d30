"""The command line: `topdress --help`. Each command has a file of its own; what is heavy is imported when it runs."""
from __future__ import annotations

from typing import Annotated

import typer

from console.cli import (
    calibrate,
    check,
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
from console.cli.plain_errors import guarded
from console.cli.plain_output import take_terminals
from console.threads import few_for_matrices

app = typer.Typer(name="topdress", no_args_is_help=False, add_completion=False, rich_markup_mode=None,
                  pretty_exceptions_enable=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.callback(invoke_without_command=True)
def console(context: typer.Context,
            version: Annotated[bool, typer.Option("--version", help="Say the version and end.")] = False) -> None:
    """Terminal console of a variable-rate fertilizer applicator. Without a command: the console on the simulated
    machine."""
    if version:
        from drivers.files.run_meta import software_version
        typer.echo(f"topdress {software_version()}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        guarded(run.run)()


app.command("run")(guarded(run.run))
app.command("replay")(guarded(replay.replay))
app.command("simulate")(guarded(simulate.simulate))
app.command("diagnose")(guarded(diagnose.diagnose))
app.command("watch")(guarded(watch.watch))
app.command("fleet")(guarded(fleet.fleet))
app.command("history")(guarded(history.history))
app.command("calibrate")(guarded(calibrate.calibrate))
app.command("effects")(guarded(effects.effects))
app.command("decode")(guarded(decode.decode))
app.command("import")(guarded(import_log.import_log))
app.command("map")(guarded(map_command.map_files))
app.command("reproduce")(guarded(reproduce_command.reproduce))
app.command("check")(guarded(check.check))
app.command("devices")(guarded(devices.devices))
app.command("serve")(guarded(serve_command.serve))
app.command("serve-machine")(guarded(serve_machine.serve_machine))


def main() -> None:
    """The entry point `topdress`."""
    few_for_matrices()
    import control
    if not hasattr(control, "log_row") and _foreign(control.__doc__):
        typer.echo("another package (python-control) is installed over topdress's folder `control`: install topdress "
                   "in an environment of its own, e.g. with pipx or `uv tool install`", err=True)
        raise SystemExit(1)
    take_terminals()
    app()


def _foreign(doc: str | None) -> bool:
    return not (doc or "").startswith("What is decided and modelled.")

"""How does `topdress serve-machine` provide the virtual machine for the real drivers?"""

from __future__ import annotations

import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.inputs import JobName, MachineName, PlantedEffects
from topdress.console.cli.outputs import ForceOption, Output, refuse_collisions
from topdress.console.cli.plain_errors import CommandError
from topdress.drivers import day_clock

if TYPE_CHECKING:
    from topdress.control.field.job import Job

PLANT_STEP_S = 0.02


def serve_virtual_machine(
    *,
    machine: MachineName = "huanghai",
    job: JobName = "demo",
    seed: Annotated[int, typer.Option(metavar="NUMBER", min=0, help="Of canopy and noise.")] = 1,
    effect: PlantedEffects = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:DEVICE@FROM_S[+FOR_S]",
            help="Spoil a device's line: unplug, garbage, half_lines, frozen, "
            "delayed, duplicated, bit_flips, wrong_baud (repeatable). DEVICE heads: all of "
            "them. Or a drive that does "
            "not obey: shaft_turns:board, gate_opens:board.",
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address to listen on.")
    ] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(metavar="PORT", min=0, max=65000, help="First TCP port; 0: any free ones."),
    ] = 4100,
    pty: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Pseudo-terminals too, with their names in this folder."
        ),
    ] = None,
    rate_module: Annotated[
        bool, typer.Option("--rate-module", help="A rate module on UDP turns the shaft.")
    ] = False,
    agopengps: Annotated[
        bool, typer.Option("--agopengps", help="Positions on UDP 17777 too.")
    ] = False,
    lag_rig: Annotated[
        bool,
        typer.Option(
            "--lag-rig",
            help="The machine stands, for calibrating, with the lag rig under its outlets.",
        ),
    ] = False,
    seconds: Annotated[
        float,
        typer.Option(metavar="SECONDS", min=0.0, help="End after this long; 0: when interrupted."),
    ] = 0.0,
    force: ForceOption = False,
) -> None:
    """The simulated machine behind every protocol, in real time. `topdress run --config
    virtual` connects to it."""
    from topdress.control.machine.fault_injection import parse_planted
    from topdress.control.simulation.assembly import add_simulated_field, make_plant
    from topdress.drivers.devices.rate_module import DEFAULT_MODULE_PORT
    from topdress.drivers.files.run_setup import load_setup
    from topdress.drivers.virtual.faults import parse_fault
    from topdress.drivers.virtual.served_machine import ServedMachine, ServeOptions

    setup = load_setup(machine, job, day_clock.read_today())
    field = add_simulated_field(
        _make_standing_job(setup.job) if lag_rig else setup.job, setup.machine
    )
    plant = make_plant(
        setup.machine, field, seed, PLANT_STEP_S, [parse_planted(text) for text in effect or ()]
    )
    plain = ServeOptions(
        host=host,
        first_port=port,
        heads=setup.machine.geometry.heads,
        opening_mm=setup.machine.set_points.opening_mm,
        terminals=pty,
        rate_module=(host, DEFAULT_MODULE_PORT) if rate_module else None,
        agopengps=("127.0.0.1", 17777) if agopengps else None,
    )
    serve = plain.replace_faults([parse_fault(text, plain.devices) for text in fault or ()])
    if pty is not None:
        names = [pty / device for device in plain.devices]
        refuse_collisions(setup.files, [Output((name,), name.is_symlink) for name in names], force)
    try:
        served = ServedMachine(plant, serve, time.monotonic)
    except OSError as error:
        raise CommandError(
            f"serve-machine: {host}, ports from {port}: {error.strerror or error}"
        ) from None
    for address in served.addresses:
        typer.echo(f"{address.device:12} {address.protocol:16} {address.url}")
    typer.echo("serving; Ctrl+C ends it")
    started_s = time.monotonic()
    # SIGTERM ends the block normally, so that the names of terminals are removed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        while not seconds or time.monotonic() - started_s < seconds:
            for change in served.advance_plant():
                typer.echo(f"{time.monotonic() - started_s:7.1f} s  {change}")
            time.sleep(PLANT_STEP_S / 4.0)
    except KeyboardInterrupt:
        pass
    finally:
        served.close()


def _make_standing_job(job: Job) -> Job:
    from topdress.control.field.job import SpeedChange

    stands = SpeedChange(at_s=0.0, speed_kmh=0.0)
    return job.model_copy(
        update={"simulated": job.simulated.model_copy(update={"speed_changes": (stands,)})}
    )

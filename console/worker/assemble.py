"""From options to the parts of one run: the only place where the worker meets real devices,
loop and log."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import platformdirs
from topdress.console.worker.options import Options
from topdress.console.worker.parts import Assembly, Bench, Names
from topdress.console.worker.program import Clock
from topdress.console.worker.resume import snapshot_path
from topdress.console.worker.resume_assemble import (
    find_earlier_job,
    find_job_to_continue,
    go_on,
    started,
)
from topdress.console.worker.resume_field import list_logs_here
from topdress.console.worker.resume_keeper import Keeper
from topdress.console.worker.resume_tail import add_log_tail
from topdress.control.field.job import Job, rule_of
from topdress.control.machine.fault_injection import parse_planted
from topdress.control.machine.machine import Machine
from topdress.control.orders import State, TargetSource
from topdress.control.readings import DriveCommand, Measurements
from topdress.control.simulation.assembly import (
    control_loop,
    simulated_machine,
    with_simulated_field,
)
from topdress.control.simulation.plant import Plant
from topdress.drivers import day_clock
from topdress.drivers.cab import BoardConfig, Cab, CabConfig
from topdress.drivers.cab_config import MODULE_STOPS_S
from topdress.drivers.cab_line import DeviceLine
from topdress.drivers.device_status import DeviceStatus
from topdress.drivers.devices.board_frames import SILENT_HOST_S
from topdress.drivers.devices.lag_rig import RigReadings
from topdress.drivers.files.config import ConfigError, Loaded
from topdress.drivers.files.kinds import CAB, MACHINE
from topdress.drivers.files.prescriptions.for_job import LoopTargets, placed_of_job
from topdress.drivers.files.run_log import RunLogWriter
from topdress.drivers.files.run_meta import run_meta
from topdress.drivers.files.setup import (
    Setup,
    by_kind,
    disagreements,
    index_disagreements,
    setup_of,
)
from topdress.drivers.virtual.machine import VirtualMachine, virtual_cab

# The simulated machine as a bench: stepped by the loop's own ticks, reached through the same
# bytes as a real one.
PARKED = (State.OFF, State.READY, State.CALIBRATING)


class SimulatedBench:
    """A cab plugged into a virtual machine that is brought up to the tick's time before it is read.

    Where the plant is given, its driver stands while the machine is off, ready or calibrating,
    and drives once it works: `state` tells which.
    """

    def __init__(self, cab: Cab, machine: VirtualMachine, plant: Plant | None = None) -> None:
        self._cab = cab
        self._machine = machine
        self._plant = plant
        self.state: Callable[[], State] = lambda: State.OFF

    def measure(self, now_s: float) -> Measurements:
        if self._plant is not None:
            self._plant.parked = self.state() in PARKED
        self._machine.advance(now_s)
        return self._cab.measure(now_s)

    def command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        self._cab.command(now_s, command, enabled)

    def status(self, now_s: float) -> Sequence[DeviceStatus]:
        return self._cab.status(now_s)

    def line(self, name: str) -> DeviceLine | None:
        return self._cab.line(name)

    @property
    def rig(self) -> RigReadings | None:
        return self._cab.rig

    def order_rig(self, run: int, arm: bool) -> None:
        self._cab.order_rig(run, arm)

    def close(self) -> None:
        self._cab.close()
        self._machine.close()


# at most: what the simulated sensors say is late by less than that
PLANT_STEP_S = 0.02


def assemble(options: Options, clock: Clock) -> Assembly:
    """Build bench, loop and log writer; without a cab file the machine is the simulated one.

    Raises ValueError or OSError with one line for each thing that is to be put right.
    """
    now, log = _utc_now(), _log_path(options.log)
    cab, setup = _configured(options, log.parent, now)
    if cab is not None and options.effects:
        raise ValueError(
            f"--effect {options.effects[0]}: effects can be planted in the simulated machine only, "
            f"and {cab.path} names a real one"
        )
    machine, sha256 = setup.machine, dict(setup.sha256)
    bench: Bench
    has_work_switch = record_only = False
    simulated = _is_simulated(cab)
    job = with_simulated_field(setup.job, machine) if simulated else setup.job
    if cab is not None:
        sha256[str(cab.path)] = cab.sha256
    before = find_earlier_job(options.resume, log.parent, job, sha256, simulated, now)
    if before.job is not None:
        left = add_log_tail(before.job, machine, setup.crop.product_n_fraction, _stops_s(cab))
        before, job = (
            before._replace(job=left),
            find_job_to_continue(job, machine, left, before.same_files),
        )
    placed = _placed(job, setup)
    if cab is None:
        bench = _simulated(options, machine, job, clock)
    else:
        assert isinstance(cab.model, CabConfig)
        devices, has_work_switch, record_only = (
            cab.model,
            cab.model.has_work_switch,
            cab.model.record_only,
        )
        if devices.rate_module is not None and devices.rate_module.fixed_opening_mm is not None:
            machine = with_fixed_gate(machine, devices.rate_module.fixed_opening_mm)
        bench = Cab(devices, clock)
    now_utc = now.isoformat(timespec="milliseconds")
    rule = rule_of(setup.crop, job, setup.rule.days)
    loop = control_loop(
        machine, setup.crop, rule, job, has_work_switch, **placed, record_only=record_only
    )
    if isinstance(bench, SimulatedBench):
        bench.state = lambda: loop.safety.state
    before = before.on(loop.plane)
    go_on(loop, before)
    meta = run_meta(
        machine,
        setup.crop,
        job,
        seed=options.seed if cab is None else None,
        sha256=sha256,
        started_utc=now_utc,
        extra={"job_folder": str(setup.folder)}
        | ({"effects": list(options.effects)} if options.effects else {})
        | ({} if before.job is None else {"resumes": before.job.log_path}),
    )
    writer = RunLogWriter(log, meta)
    names = Names(
        job.title or job.id,
        machine.title or machine.id,
        setup.crop.name,
        str(writer.path),
        simulated,
    )
    keeper = Keeper(
        snapshot_path(writer.path),
        machine,
        started(
            options,
            writer.path,
            (names.job, names.machine, names.crop),
            simulated,
            now_utc,
            before.job,
        ),
        loop,
        lambda: _utc_now().isoformat(timespec="milliseconds"),
    )
    writer.after_writing = keeper.work
    return Assembly(bench, loop, writer, names, keeper)


def _is_simulated(cab: Loaded[Any] | None) -> bool:
    return cab is None or bool(getattr(cab.model, "virtual", False))


def _configured(options: Options, logs: Path, now: dt.datetime) -> tuple[Loaded[Any] | None, Setup]:
    """The cab file, where there is one, and the setup, held against each other. logs: their
    folder. Raises ValueError."""
    try:
        found = by_kind(options.config)
        cab = found.get(CAB.format)
        setup = setup_of(
            found, day_clock.today(), lambda job: list_logs_here(logs, job, _is_simulated(cab), now)
        )
        lines = index_disagreements(cab, setup.crop, setup.job)
        if cab is not None:
            named = (
                found[MACHINE.format].path
                if MACHINE.format in found
                else "the shipped machine huanghai"
            )
            lines = [*disagreements(cab, setup.machine, str(named)), *lines]
        if lines:
            raise ConfigError(lines)
    except ConfigError as error:
        raise ValueError(str(error)) from error
    return cab, setup


def _stops_s(cab: Loaded[Any] | None) -> float | None:
    """How long the drive of the shaft goes on without the console; None: a simulated one ends
    with the worker."""
    if cab is None:
        return None
    assert isinstance(cab.model, CabConfig)
    return MODULE_STOPS_S if cab.model.rate_module is not None else SILENT_HOST_S


def with_fixed_gate(machine: Machine, opening_mm: float) -> Machine:
    """The machine whose gate is set by hand: no strategy can move it, all of them meter by the
    shaft."""
    limits = machine.limits.model_copy(
        update={
            "opening_low_mm": opening_mm,
            "opening_high_mm": opening_mm + machine.limits.opening_resolution_mm / 100.0,
        }
    )
    set_points = machine.set_points.model_copy(update={"opening_mm": opening_mm})
    return machine.model_copy(update={"limits": limits, "set_points": set_points})


def _placed(job: Job, setup: Setup) -> LoopTargets:
    """Map, plants, index map and done ground of the job. Raises ValueError, OSError."""
    placed = placed_of_job(job, setup.folder, setup.machine, setup.crop.index)
    if job.target.source is TargetSource.POINT and placed["plants"] is None:
        raise ValueError(
            f"{job.id}: target.source point: a camera has no driver yet: allowed is "
            "target.plants, a "
            "plant list next to the job file"
        )
    return placed


def _simulated(options: Options, machine: Machine, job: Job, clock: Clock) -> SimulatedBench:
    planted = [parse_planted(text) for text in options.effects]
    plant = simulated_machine(
        machine, job, options.seed, min(PLANT_STEP_S, 1.0 / options.hz), planted
    )
    board = BoardConfig(
        port="",
        max_shaft_rpm=machine.limits.shaft_high_rpm,
        max_opening_mm=machine.limits.opening_high_mm,
        wheel_circumference_m=machine.speed.wheel_circumference_m,
        wheel_pulses_per_turn=machine.speed.pulses_per_turn,
    )
    index = job.simulated.heads_index
    cab, virtual = virtual_cab(
        plant,
        clock,
        heads=machine.geometry.heads,
        board=board,
        protocol="greenseeker" if index == "ndvi" else "acs430",
        opening_mm=machine.set_points.opening_mm,
        index=index,
    )
    return SimulatedBench(cab, virtual, plant)


def _log_path(wanted: str | None) -> Path:
    """The log's name as wanted, else a new one in the user's data folder. Raises OSError,
    ValueError."""
    if wanted is None:
        folder = Path(platformdirs.user_data_dir("topdress", appauthor=False)) / "logs"
        path = folder / f"{_utc_now():%Y%m%d-%H%M%S}.csv"
    else:
        path = Path(wanted)
        if path.suffix != ".csv":
            raise ValueError(f"--log {wanted}: allowed is a name that ends in .csv")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    # a loop of links is reported as a file that is there
    except OSError as error:
        raise ValueError(
            f"--log {path}: its folder cannot be made: {error.strerror or error}"
        ) from None
    return path


def _utc_now() -> dt.datetime:
    return day_clock.utc_now()

"""Builds the parts of one run from its options. Only this module of the worker meets real devices,
loop and log together.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import platformdirs
from topdress.console.worker.options import Options
from topdress.console.worker.program import Clock
from topdress.console.worker.resume import make_snapshot_path
from topdress.console.worker.resume_assemble import (
    continue_loop,
    find_earlier_job,
    find_job_to_continue,
    make_first_snapshot,
)
from topdress.console.worker.resume_field import list_logs_here
from topdress.console.worker.resume_keeper import SnapshotKeeper
from topdress.console.worker.resume_tail import add_log_tail
from topdress.console.worker.run_interfaces import MachineDevices, RunAssembly, RunNames
from topdress.control.field.job import Job, make_rule
from topdress.control.machine.fault_injection import parse_planted
from topdress.control.machine.machine import Machine
from topdress.control.orders import State, TargetSource
from topdress.control.readings import DriveCommand, Measurements
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.plant import Plant
from topdress.drivers import day_clock
from topdress.drivers.cab import Cab, PortOpener
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.cab_line import DeviceLine
from topdress.drivers.datagrams import open_line
from topdress.drivers.device_status import DeviceStatus
from topdress.drivers.devices.board_frames import BOARD_STOP_TIMEOUT_S
from topdress.drivers.devices.lag_rig import RigReadings
from topdress.drivers.devices.rate_module import MODULE_TIMEOUT_S
from topdress.drivers.devices.slave_board import BoardConfig
from topdress.drivers.files.config import ConfigError, LoadedConfig
from topdress.drivers.files.config_kinds import CAB_KIND, MACHINE_KIND
from topdress.drivers.files.prescriptions.job_targets import LoopTargets, read_loop_targets
from topdress.drivers.files.run_log import RunLogWriter
from topdress.drivers.files.run_meta import RunMeta, make_run_meta
from topdress.drivers.files.run_setup import (
    Setup,
    build_setup,
    find_disagreements,
    find_index_disagreements,
    load_by_kind,
)
from topdress.drivers.virtual.machine import VirtualMachine, make_virtual_cab

# The simulated machine is a bench that the loop's own ticks advance, and that is reached through
# the same bytes as a real machine. In these states its driver stands.
PARKED_STATES = (State.OFF, State.READY, State.CALIBRATING)


class SimulatedBench:
    """Drives a cab that is connected to a virtual machine, which is advanced to the time of the
    tick before it is read.

    With a plant, the driver stands while the machine is off, ready or calibrating, and drives once
    the machine works; `state` returns the state of the loop.
    """

    def __init__(self, cab: Cab, machine: VirtualMachine, plant: Plant | None = None) -> None:
        self._cab = cab
        self._machine = machine
        self._plant = plant
        # `assemble_run` replaces this function once the loop exists.
        self.state: Callable[[], State] = lambda: State.OFF

    def read_measurements(self, now_s: float) -> Measurements:
        """Advance the virtual machine to `now_s` (run time, s) and read its sensors."""
        if self._plant is not None:
            self._plant.parked = self.state() in PARKED_STATES
        self._machine.advance_to(now_s)
        return self._cab.read_measurements(now_s)

    def send_command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        """Send the set-points of the drives (None for none) to the virtual boards."""
        self._cab.send_command(now_s, command, enabled)

    def list_device_status(self, now_s: float) -> Sequence[DeviceStatus]:
        """Return the status of each device at `now_s`, s."""
        return self._cab.list_device_status(now_s)

    def find_device_line(self, name: str) -> DeviceLine | None:
        """Return the line of a device by its name, or None."""
        return self._cab.find_device_line(name)

    @property
    def rig_readings(self) -> RigReadings | None:
        """Newest line of the lag rig; None without a rig."""
        return self._cab.rig_readings

    def send_rig_order(self, run: int, arm: bool) -> None:
        """Start run number `run` of the rig, and arm the rig for an impulse."""
        self._cab.send_rig_order(run, arm)

    def close_devices(self) -> None:
        """Close the cab's ports, then the virtual machine."""
        self._cab.close_devices()
        self._machine.close()


# Longest step of the simulation, s; readings of simulated sensors are delayed by at most this step.
MAX_PLANT_STEP_S = 0.02


def assemble_run(
    options: Options,
    clock: Clock,
    open_log: Callable[[Path, RunMeta], RunLogWriter] = RunLogWriter,
    open_port: PortOpener = open_line,
) -> RunAssembly:
    """Build bench, loop and log writer; without a cab file the machine is simulated.

    Parameters
    ----------
    options
        Options of the command line.
    clock
        Returns the run time, s.
    open_log
        Creates the log; a simulation gives a writer without a thread.
    open_port
        Opens the lines of the cab file.

    Raises
    ------
    ValueError, OSError
        One line for each fault that the user has to correct.
    """
    now, log = _read_utc_now(), _choose_log_path(options.log)
    cab, setup = _read_configuration(options, log.parent, now)
    # Effects on a real machine would be faults in the field.
    if cab is not None and options.effects:
        raise ValueError(
            f"--effect {options.effects[0]}: effects can be planted in the simulated machine only, "
            f"and {cab.path} names a real one"
        )
    machine, sha256 = setup.machine, dict(setup.sha256)
    # The bench is real or simulated; the loop is the same for both.
    bench: MachineDevices
    has_work_switch = record_only = False
    simulated = _is_simulated_cab(cab)
    # A simulated machine without a field would drive without a boundary or map.
    job = add_simulated_field(setup.job, machine) if simulated else setup.job
    if cab is not None:
        # The checksums in the log's metadata identify every file of the run.
        sha256[str(cab.path)] = cab.sha256
    # The earlier job is read before the loop is built, because it may change the job's values.
    before = find_earlier_job(options.resume, log.parent, job, sha256, simulated, now)
    if before.job is not None:
        # The snapshot is some seconds older than the log's last row.
        left = add_log_tail(
            before.job, machine, setup.crop.product_n_fraction, _find_drive_stop_s(cab)
        )
        before, job = (
            before._replace(job=left),
            find_job_to_continue(job, machine, left, before.same_files),
        )
    placed = _read_targets(job, setup)
    if cab is None:
        bench = _make_simulated_bench(options, machine, job, clock)
    else:
        assert isinstance(cab.model, CabConfig)
        devices, has_work_switch, record_only = (
            cab.model,
            cab.model.has_work_switch,
            cab.model.record_only,
        )
        if devices.rate_module is not None and devices.rate_module.fixed_opening_mm is not None:
            # A rate module without a gate drive meters by the shaft alone.
            machine = fix_gate_opening(machine, devices.rate_module.fixed_opening_mm)
        bench = Cab(devices, clock, open_port)
    now_utc = now.isoformat(timespec="milliseconds")
    rule = make_rule(setup.crop, job, setup.rule.days)
    loop = make_control_loop(
        machine, setup.crop, rule, job, has_work_switch, **placed, record_only=record_only
    )
    # The bench needs the loop's state, and the loop is built after the bench.
    if isinstance(bench, SimulatedBench):
        bench.state = lambda: loop.safety.state
    before = before.move_to_plane(loop.plane)
    continue_loop(loop, before)
    meta = make_run_meta(
        machine,
        setup.crop,
        job,
        seed=options.seed if cab is None else None,
        sha256=sha256,
        started_utc=now_utc,
        # The diagnosis finds the job's files by its folder.
        extra={"job_folder": str(setup.folder)}
        | ({"effects": list(options.effects)} if options.effects else {})
        | ({} if before.job is None else {"resumes": before.job.log_path}),
    )
    # The log is opened last: an earlier failure must not leave an empty log.
    writer = open_log(log, meta)
    names = RunNames(
        job.title or job.id,
        machine.title or machine.id,
        setup.crop.name,
        str(writer.path),
        simulated,
    )
    keeper = SnapshotKeeper(
        make_snapshot_path(writer.path),
        machine,
        make_first_snapshot(
            options,
            writer.path,
            (names.job, names.machine, names.crop),
            simulated,
            now_utc,
            before.job,
        ),
        loop,
        lambda: _read_utc_now().isoformat(timespec="milliseconds"),
    )
    writer.after_writing = keeper.save_due
    return RunAssembly(bench, loop, writer, names, keeper)


def _is_simulated_cab(cab: LoadedConfig[Any] | None) -> bool:
    """Return whether the machine is simulated: no cab file, or a virtual cab."""
    return cab is None or bool(getattr(cab.model, "virtual", False))


def _read_configuration(
    options: Options, logs: Path, now: dt.datetime
) -> tuple[LoadedConfig[Any] | None, Setup]:
    """Read the cab file, if given, and the setup, and check them against each other.

    Parameters
    ----------
    options
        Options of the command line.
    logs
        Folder of the logs.
    now
        Time of the start, UTC.

    Raises
    ------
    ValueError
        One line for each fault.
    """
    try:
        found = load_by_kind(options.config)
        cab = found.get(CAB_KIND.format)
        setup = build_setup(
            found,
            day_clock.read_today(),
            lambda job: list_logs_here(logs, job, _is_simulated_cab(cab), now),
        )
        # Disagreements are collected, so that the user sees all of them at once.
        lines = find_index_disagreements(cab, setup.crop, setup.job)
        if cab is not None:
            named = (
                found[MACHINE_KIND.format].path
                if MACHINE_KIND.format in found
                else "the shipped machine huanghai"
            )
            lines = [*find_disagreements(cab, setup.machine, str(named)), *lines]
        if lines:
            raise ConfigError(lines)
    except ConfigError as error:
        raise ValueError(str(error)) from error
    return cab, setup


def _find_drive_stop_s(cab: LoadedConfig[Any] | None) -> float | None:
    """Return the time for which the shaft's drive continues without its host, s. None means that
    the drive ends with the worker, as a simulated drive does."""
    if cab is None:
        return None
    assert isinstance(cab.model, CabConfig)
    # A rate module has a watchdog of its own duration.
    return MODULE_TIMEOUT_S if cab.model.rate_module is not None else BOARD_STOP_TIMEOUT_S


def fix_gate_opening(machine: Machine, opening_mm: float) -> Machine:
    """Return a copy of a machine whose gate is set by hand, so that every strategy meters by the
    shaft.

    Parameters
    ----------
    machine
        Machine with a movable gate.
    opening_mm
        Opening at which the gate stands, mm.
    """
    limits = machine.limits.model_copy(
        update={
            "opening_low_mm": opening_mm,
            # The range must not be empty, so it is a hundredth of the gate's resolution.
            "opening_high_mm": opening_mm + machine.limits.opening_resolution_mm / 100.0,
        }
    )
    set_points = machine.set_points.model_copy(update={"opening_mm": opening_mm})
    return machine.model_copy(update={"limits": limits, "set_points": set_points})


def _read_targets(job: Job, setup: Setup) -> LoopTargets:
    """Read map, plants, index map and finished ground of the job. Raises ValueError or OSError."""
    placed = read_loop_targets(job, setup.folder, setup.machine, setup.crop.index)
    if job.target.source is TargetSource.POINT and placed["plants"] is None:
        raise ValueError(
            f"{job.id}: target.source point: a camera has no driver yet: allowed is "
            "target.plants, a "
            "plant list next to the job file"
        )
    return placed


def _make_simulated_bench(
    options: Options, machine: Machine, job: Job, clock: Clock
) -> SimulatedBench:
    """Build the simulated machine with its planted effects and virtual boards."""
    # Known effects make a log whose diagnosis can be checked.
    planted = [parse_planted(text) for text in options.effects]
    plant = make_plant(machine, job, options.seed, min(MAX_PLANT_STEP_S, 1.0 / options.hz), planted)
    # The virtual board has the limits of the machine file, as a well configured real board would.
    board = BoardConfig(
        port="",
        max_shaft_rpm=machine.limits.shaft_high_rpm,
        max_opening_mm=machine.limits.opening_high_mm,
        wheel_circumference_m=machine.speed.wheel_circumference_m,
        wheel_pulses_per_turn=machine.speed.pulses_per_turn,
    )
    index = job.simulated.heads_index
    cab, virtual = make_virtual_cab(
        plant,
        clock,
        heads=machine.geometry.heads,
        board=board,
        protocol="greenseeker" if index == "ndvi" else "acs430",
        opening_mm=machine.set_points.opening_mm,
        index=index,
    )
    return SimulatedBench(cab, virtual, plant)


def _choose_log_path(wanted: str | None) -> Path:
    """Return the path of the log: as given, else a new name in the user's data folder. Raises
    OSError or ValueError."""
    if wanted is None:
        folder = Path(platformdirs.user_data_dir("topdress", appauthor=False)) / "logs"
        path = folder / f"{_read_utc_now():%Y%m%d-%H%M%S}.csv"
    else:
        path = Path(wanted)
        if path.suffix != ".csv":
            raise ValueError(f"--log {wanted}: allowed is a name that ends in .csv")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    # A circle of symbolic links is reported as an existing file, so all errors are handled alike.
    except OSError as error:
        raise ValueError(
            f"--log {path}: its folder cannot be made: {error.strerror or error}"
        ) from None
    return path


def _read_utc_now() -> dt.datetime:
    """Return the present time, UTC."""
    return day_clock.read_utc_now()

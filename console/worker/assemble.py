"""From options to the parts of one run: the only place where the worker meets real devices, loop and log."""
from __future__ import annotations

import datetime as dt
from pathlib import Path

import platformdirs

from console.worker.parts import Assembly, Bench, Names
from console.worker.program import Clock, Options
from console.worker.simulated_bench import SimulatedBench
from control.machine.machine import Machine
from control.machine.planting import parse_planted
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from drivers.cab import BoardConfig, Cab, CabConfig
from drivers.files.config import load_any
from drivers.files.kinds import KINDS
from drivers.files.run_log import RunLogWriter
from drivers.files.run_meta import run_meta
from drivers.files.setup import Setup, load_setup
from drivers.virtual.machine import virtual_cab

PLANT_STEP_S = 0.05


def assemble(options: Options, clock: Clock) -> Assembly:
    """Build bench, loop and writer. Raises ValueError or OSError with one line that says what to put right."""
    given: dict[str, str] = {}
    cab: CabConfig | None = None
    for where in options.config:
        kind, loaded = load_any(where, KINDS)
        if kind.folder in given:
            raise ValueError(f"{where}: a second file of kind {kind.format}: allowed is one")
        given[kind.folder] = str(loaded.path)
        if isinstance(loaded.model, CabConfig):
            cab = loaded.model
    now = dt.datetime.now(dt.UTC)
    setup = load_setup(given.get("machines", "huanghai"), given.get("jobs", "demo"), now.date())
    if cab is None:
        job = with_simulated_field(setup.job, setup.machine)
        bench: Bench = _simulated(options, setup, clock)
    else:
        job = setup.job
        bench = Cab(cab, clock)
    path = Path(options.log) if options.log else _log_folder() / f"{now:%Y-%m-%d-%H%M%S}-{job.id}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    meta = run_meta(setup.machine, setup.crop, job, seed=options.seed if cab is None else None, sha256=setup.sha256,
                    started_utc=now.isoformat(timespec="milliseconds").replace("+00:00", "Z"))
    writer = RunLogWriter(path, meta)
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    names = Names(job.title or job.id, setup.machine.title or setup.machine.id, setup.crop.name, str(writer.path),
                  cab is None)
    return Assembly(bench, loop, writer, names)


def _simulated(options: Options, setup: Setup, clock: Clock) -> SimulatedBench:
    planted = [parse_planted(text) for text in options.effects]
    step_s = min(PLANT_STEP_S, 1.0 / options.hz)
    plant = simulated_machine(setup.machine, setup.job, options.seed, step_s, planted)
    cab, machine = virtual_cab(plant, clock, heads=setup.machine.geometry.heads, board=_board(setup.machine),
                               opening_mm=setup.machine.set_points.opening_mm)
    return SimulatedBench(cab, machine)


def _board(machine: Machine) -> BoardConfig:
    return BoardConfig(port="", max_shaft_rpm=machine.limits.shaft_high_rpm,
                       max_opening_mm=machine.limits.opening_high_mm,
                       wheel_circumference_m=machine.speed.wheel_circumference_m,
                       wheel_pulses_per_turn=machine.speed.pulses_per_turn)


def _log_folder() -> Path:
    return Path(platformdirs.user_data_dir("topdress", appauthor=False)) / "logs"

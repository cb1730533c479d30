"""One machine at work, reached through its bytes, and everything that can go wrong with it:
what benchmarks share.

Plant, virtual board and devices, lines in memory with faults in them, the cab's drivers and the
control loop, all on one clock that only `tick` moves.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterable
from typing import Any

from topdress.control.field.job import Simulated
from topdress.control.loop.tick import Tick
from topdress.control.machine.fault_injection import parse_planted
from topdress.control.orders import Do, Order, State
from topdress.control.readings import DriveCommand
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.plant import Plant, PlantTruth, SensorReadings
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.canopy_heads import HeadsConfig
from topdress.drivers.devices.fix_source import GnssConfig
from topdress.drivers.devices.slave_board import BoardConfig
from topdress.drivers.files.prescriptions.job_targets import read_job_map
from topdress.drivers.files.run_setup import load_setup
from topdress.drivers.ports import make_memory_pair
from topdress.drivers.virtual.faults import DriveRunaway, VirtualRunaway
from topdress.drivers.virtual.machine import VirtualMachine

DAY = dt.date(2026, 4, 1)
DT_S = 0.05


class Lying:
    """The plant as the bytes have it: its sensors through `lie`, its shaft `turns` times as
    fast as commanded."""

    def __init__(
        self,
        plant: Plant,
        lie: Callable[[SensorReadings], SensorReadings],
        turns: Callable[[float], float],
    ) -> None:
        self.dt_s = plant.dt_s
        self._plant, self._lie, self._turns = plant, lie, turns

    def advance_plant(self, command: DriveCommand, enabled: bool) -> SensorReadings:
        turns = self._turns(self._plant.time_s)
        return self._lie(
            self._plant.advance_plant(
                command._replace(shaft_rpm=turns * command.shaft_rpm), enabled
            )
        )


class Rig:
    """The whole way from the loop to the plant and back. `runaway`, `switch_up` and the lines'
    faults may be set at any time.

    lie : what the sensors make of what they sense. turns : times what the shaft is commanded,
    by the time. effects : of the plant, as `topdress simulate --effect` has them. parks : the
    tractor stands while the machine is off or ready. sim : of the job's simulation, where it
    differs.
    """

    def __init__(
        self,
        machine: str = "huanghai",
        job: str = "demo",
        seed: int = 1,
        *,
        dt_s: float = DT_S,
        parks: bool = True,
        lie: Callable[[SensorReadings], SensorReadings] = lambda sensed: sensed,
        turns: Callable[[float], float] = lambda at_s: 1.0,
        effects: Iterable[str] = (),
        **sim: Any,
    ) -> None:
        self.setup = setup = load_setup(machine, job, DAY)
        simulated = Simulated.model_validate(setup.job.simulated.model_dump() | sim)
        self.job = add_simulated_field(
            setup.job.model_copy(update={"simulated": simulated}), setup.machine
        )
        self.now_s, self.runaway, self.switch_up, self._parks = 0.0, DriveRunaway(), False, parks
        self.plant = make_plant(
            setup.machine, self.job, seed, dt_s, [parse_planted(text) for text in effects]
        )
        self.heads = [f"head_{k}" for k in range(1, 1 + setup.machine.geometry.heads)]
        pairs = {
            name: make_memory_pair(name, self.clock) for name in ("gnss", *self.heads, "board")
        }
        self.ports = {name: pair[0] for name, pair in pairs.items()}
        self.board_line = pairs["board"][1]
        self.cab = self.fresh_cab()
        self.virtual = VirtualMachine(
            Lying(self.plant, lie, turns),
            pairs["gnss"][1],
            [pairs[name][1] for name in self.heads],
            self.board_line,
            0.0,
            opening_mm=setup.machine.set_points.opening_mm,
            extras=[VirtualRunaway(lambda at_s: self.runaway, 0.0)],
        )
        self.loop = make_control_loop(
            setup.machine,
            setup.crop,
            setup.rule,
            self.job,
            prescription=read_job_map(self.job, setup.folder),
        )
        self.ticks: list[Tick] = []

    def clock(self) -> float:
        return self.now_s

    def fresh_cab(self) -> Cab:
        """As a console that was started again has it: it remembers nothing of the lines."""
        config = CabConfig(
            gnss=GnssConfig(port="gnss"),
            board=BoardConfig(port="board"),
            heads=HeadsConfig(
                protocol="greenseeker", ports=tuple(self.heads), heads=len(self.heads)
            ),
        )
        return Cab(config, self.clock, lambda url, _baud, _clock: self.ports[url])

    def tick(self, each: Callable[[], object] = lambda: None) -> None:
        """each : called once the plant is where the tick finds it."""
        self.now_s += DT_S
        if self._parks:
            self.plant.parked = self.loop.safety.state in (
                State.OFF,
                State.READY,
                State.CALIBRATING,
            )
        self.virtual.advance_to(self.now_s)
        each()
        m = self.cab.read_measurements(self.now_s)
        tick = self.loop.run_tick(m._replace(work_switch=False) if self.switch_up else m, 0.0, True)
        self.cab.send_command(self.now_s, tick.command, tick.is_enabled)
        self.ticks.append(tick)

    def run(self, seconds: float, each: Callable[[], object] = lambda: None) -> Tick:
        for _ in range(round(seconds / DT_S)):
            self.tick(each)
        return self.ticks[-1]

    def order(self, do: Do, value: Any = None) -> None:
        answer = self.loop.handle_order(Order(do, value))
        assert answer.accepted, (do, answer)

    def work(self, seconds: float = 15.0) -> None:
        self.run(2.0)
        self.order(Do.READY)
        self.run(2.0)
        self.order(Do.START)
        tick = self.run(seconds)
        assert tick.row.state == "working" and (tick.row.applied_rate_kg_ha or 0.0) > 50.0, tick.row

    @property
    def truth(self) -> PlantTruth:
        assert self.plant.truth is not None
        return self.plant.truth

    @property
    def hopper_kg(self) -> float:
        return self.truth.hopper_kg

    @property
    def rpm(self) -> float:
        """Of the true shaft."""
        return self.truth.shaft_rpm

    def unplug(self, *names: str) -> None:
        for name in names:
            self.ports[name].plug(False)

    def plug_in(self, *names: str) -> None:
        for name in names:
            self.ports[name].plug(True)

"""Which machine works on which field? Configuration files of each farm, and the machine itself,
which outlives every power cut: plant, board, lines, and whatever lies."""

from __future__ import annotations

import datetime as dt
import json
import math
import random
import shutil
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from topdress.control.field.job import Simulated
from topdress.control.orders import State
from topdress.control.readings import DriveCommand
from topdress.control.simulation.assembly import make_plant
from topdress.control.simulation.plant import Plant, PlantTruth, SensorReadings
from topdress.control.simulation.tractor import make_field_boundary
from topdress.drivers.devices.rate_line import make_target_sentence
from topdress.drivers.files.run_setup import Setup, load_setup
from topdress.drivers.ports import MemoryPort, Port, make_memory_pair
from topdress.drivers.virtual.board import VirtualBoard
from topdress.drivers.virtual.faults import LINE_FAULTS, PortFaults, ServedLine
from topdress.drivers.virtual.machine import VirtualMachine

from world.invariants import disobeys

ROOT = Path(__file__).resolve().parents[2]
DAY = dt.date(2026, 4, 1)
# Longest step of the plant, s: one reading of each sensor for each tick.
PLANT_STEP_S = 0.1
# Side of a bin of ground along the outlets' way, m.
BIN_M = 0.5
# Interval of the other display's sentences, s.
ASKED_PERIOD_S = 0.5
PARKED_STATES = (State.OFF, State.READY, State.CALIBRATING)
PASSES = 12


def make_files(folder: Path, farm: str, simulated: dict[str, Any]) -> tuple[str, ...]:
    """Writes the job and cab file of a farm and returns all files for the worker."""
    machine = "huanghai_sections" if farm == "sections" else "huanghai"
    sim = {"passes": PASSES, "run_in_m": 12.0} | simulated
    boundary = make_field_boundary(Simulated(**sim), 2.4, 0.0)
    field: dict[str, Any] = {"boundary_m": boundary}
    target: dict[str, Any] = {"source": "canopy"}
    if farm in ("map", "headland"):
        shutil.copy(ROOT / "configs" / "jobs" / "map_demo.geojson", folder / "map.geojson")
        target |= {"map": "map.geojson", "source": "map" if farm == "map" else "canopy"}
    if farm == "headland":
        field |= {"headland_m": 6.0, "headland_rate_kg_ha": 120.0}
    if farm == "external":
        target = {"source": "external", "external_silent_kg_ha": 150.0}
    if farm == "manual":
        target = {"source": "manual", "manual_rate_kg_ha": 220.0}
        field = {}
    job = {"format": "topdress-job/1", "id": farm, "target": target, "field": field}
    job |= {"simulated": sim}
    if farm in ("map", "sections"):
        job["planned_speed_kmh"] = sim["speed_kmh"]
    cab = {
        "format": "topdress-cab/1",
        "gnss": {"port": "/dev/gnss"},
        "heads": {
            "protocol": "greenseeker",
            "ports": [f"/dev/head_{number}" for number in range(1, 7)],
        },
        "board": {"port": "/dev/board", "work_switch": True},
        "rate_line": {"port": "/dev/rate_line"},
    }
    files = folder / f"{farm}_job.yaml", folder / f"{farm}_cab.yaml"
    # JSON is YAML too.
    for path, content in zip(files, (job, cab), strict=True):
        path.write_text(json.dumps(content), encoding="utf-8")
    return (str(files[0]), str(files[1]), machine)


def load_farm(files: tuple[str, ...]) -> Setup:
    """Returns the setup of a farm's files."""
    return load_setup(files[2], files[0], DAY)


class Lie(NamedTuple):
    """Holds a lie while it lasts."""

    name: str
    size: Any
    begin_s: float
    end_s: float


class GroundTruth:
    """Sums up by the plant what left the machine and where it landed."""

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s
        self.kg = 0.0
        self.flow_kg_s = 0.0
        self.speed_mps = 0.0
        self.newest: PlantTruth | None = None
        # Mass that landed in each bin of the outlets' way, by the part of the day, kg.
        self.bins: dict[int, dict[int, float]] = {}
        self.part = 0
        self.tray = False
        self.drop_s = 0.0

    def take_truth(self, truth: PlantTruth) -> None:
        """Adds one step of the plant."""
        self.newest = truth
        self.flow_kg_s, self.speed_mps = truth.flow_kg_s, truth.speed_mps
        if truth.flow_kg_s <= 0.0:
            return
        kg = truth.flow_kg_s * self._step_s
        self.kg += kg
        if not self.tray:
            place = int((truth.driven_m + truth.speed_mps * truth.drop_s) / BIN_M)
            parts = self.bins.setdefault(place, {})
            parts[self.part] = parts.get(self.part, 0.0) + kg


class LyingPlant:
    """Is the plant as board and receiver see it: sensors read through the lies, drives obey
    through them."""

    def __init__(self, plant: Plant) -> None:
        self.dt_s = plant.dt_s
        self.plant = plant
        self.lies: list[Lie] = []
        # The driver's wanted speed, m/s; None: that of the job.
        self.wanted_mps: float | None = None
        # Mass poured into the hopper in the next step, kg.
        self._find_speed = plant._driver._find_wanted_speed
        plant._driver._find_wanted_speed = self._find_wanted_speed  # type: ignore[method-assign]
        self._pulses_read = 0.0
        self._pulses_before = 0
        self._scale_before: float | None = None
        self.in_pass = True

    @property
    def truth(self) -> PlantTruth | None:
        """Truth of the last step."""
        return self.plant.truth

    def _find_wanted_speed(self, time_s: float) -> tuple[float, float]:
        wanted, most = self._find_speed(time_s)
        return (wanted if self.wanted_mps is None else self.wanted_mps), most

    def advance_plant(self, command: DriveCommand, enabled: bool) -> SensorReadings:
        """Advances one step."""
        now_s = self.plant.time_s
        for lie in self.lies:
            if lie.name == "shaft_turns_rpm":
                command, enabled = command._replace(shaft_rpm=lie.size), True
            elif lie.name == "shaft_stands":
                command = command._replace(shaft_rpm=0.0)
            elif lie.name == "shaft_turns_times":
                command = command._replace(shaft_rpm=lie.size * command.shaft_rpm)
            elif lie.name == "gate_stands_mm":
                command = command._replace(opening_mm=lie.size)
        sensed = self.plant.advance_plant(command, enabled)
        self.in_pass = self.plant.truth is None or self.plant.truth.in_pass
        sensed = sensed._replace(work_switch=True)
        times = 1.0
        for lie in self.lies:
            times *= lie.size if lie.name == "wheel_times" else 1.0
            change = READS.get(lie.name)
            if change is not None:
                sensed = change(sensed, lie.size, now_s - lie.begin_s)
        # Pulses that the wheel's sensor loses or adds stay lost or added.
        new = sensed.wheel_pulses - self._pulses_before
        self._pulses_before = sensed.wheel_pulses
        self._pulses_read += times * new
        return sensed._replace(
            wheel_pulses=int(self._pulses_read),
            wheel_speed_mps=times * sensed.wheel_speed_mps,
        )


def _change_fix(
    change: Callable[[Any, Any, float], dict[str, Any]],
) -> Callable[[SensorReadings, Any, float], SensorReadings]:
    def apply(sensed: SensorReadings, size: Any, since_s: float) -> SensorReadings:
        fix = sensed.gnss
        if fix is None:
            return sensed
        return sensed._replace(gnss=fix._replace(**change(fix, size, since_s)))

    return apply


def _move_fix(fix: Any, east_m: float) -> dict[str, Any]:
    return {"lon_deg": fix.lon_deg + east_m / (111_320.0 * math.cos(math.radians(fix.lat_deg)))}


# Changes of the sensors' readings by each lie: (readings, size, seconds since its begin).
READS: dict[str, Callable[[SensorReadings, Any, float], SensorReadings]] = {
    "gnss_speed_times": _change_fix(
        lambda fix, size, _: {"speed_mps": None if fix.speed_mps is None else size * fix.speed_mps}
    ),
    "place_walks_mps": _change_fix(lambda fix, size, since_s: _move_fix(fix, size * since_s)),
    "place_jumps_m": _change_fix(lambda fix, size, _: _move_fix(fix, size)),
    "shaft_reads_times": lambda s, size, _: s._replace(shaft_rpm=size * s.shaft_rpm),
    "gate_reads_more_mm": lambda s, size, _: s._replace(opening_mm=s.opening_mm + size),
    "scale_times": lambda s, size, _: s._replace(hopper_kg=size * s.hopper_kg),
    "scale_leaks_kg_s": lambda s, size, since_s: s._replace(hopper_kg=s.hopper_kg - size * since_s),
    "scale_reads_kg": lambda s, size, _: s._replace(hopper_kg=size),
    "heads_read": lambda s, size, _: s._replace(
        ndvi=None if s.ndvi is None else (size,) * len(s.ndvi)
    ),
    "valve_stays_open": lambda s, _size, _since_s: s._replace(
        valves_open=None if s.valves_open is None else (True, *s.valves_open[1:])
    ),
    "switch_up": lambda s, _size, _since_s: s._replace(work_switch=False),
    "effort_times": lambda s, size, _: s._replace(
        shaft_effort=None if s.shaft_effort is None else size * s.shaft_effort
    ),
}


class BoardWire(ServedLine):
    """Is the board's line, on which somebody may send recorded orders again."""

    def __init__(self, ends: list[Port], clock: Callable[[], float], seed: int) -> None:
        super().__init__(ends, clock, seed)
        self._recorded: deque[bytes] = deque(maxlen=100)
        self._clock = clock
        self.replays_until_s = -math.inf

    def read(self) -> bytes:
        """Returns the bytes of the host, and those that are sent again."""
        data = super().read()
        if self._clock() < self.replays_until_s and self._recorded:
            return data + self._recorded[0]
        if data:
            self._recorded.append(data)
        return data


class FarmMachine:
    """Holds tractor, applicator and devices of a day. `clock` is the world's own time, s."""

    def __init__(self, setup: Setup, seed: int, hz: float, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._random = random.Random(seed + 99)
        step_s = min(PLANT_STEP_S, 1.0 / hz)
        self.ground = GroundTruth(step_s)
        plant = make_plant(setup.machine, setup.job, seed, step_s)
        plant._keep = self.ground.take_truth
        self.lying = LyingPlant(plant)
        self._wires = {
            name: (BoardWire if name == "board" else ServedLine)(
                [make_memory_pair(name, clock)[1]], clock, seed + number
            )
            for number, name in enumerate(("gnss", "board", "rate_line", *HEAD_NAMES))
        }
        self._faults: list[tuple[str, str, float]] = []
        self._opening_mm = setup.machine.set_points.opening_mm
        self._width_m = setup.machine.geometry.working_width_m
        # The program's clock for each host's end.
        self.machine = VirtualMachine(
            self.lying,  # type: ignore[arg-type]
            self._wires["gnss"],
            [self._wires[name] for name in HEAD_NAMES],
            self._wires["board"],
            clock(),
        )
        self.asked_kg_ha: float | None = 180.0
        # Time at which a drive last turned by itself, s.
        self.disobeyed_s = -math.inf
        self._asked_due_s = 0.0
        self.restart_board()

    def open_port(self, url: str, _baud: int, clock: Callable[[], float]) -> Port:
        """Returns the host's end of a line; an earlier end is dead from now on."""
        host, device = MemoryPort(url, clock), MemoryPort(url, clock)
        host.join_ends(device)
        wire = self._wires[url.rpartition("/")[2]]
        unplugged = wire._spoiler.faults.unplugged
        wire._ends = (device,)
        if unplugged:
            device.plug(False)
        return host

    def cut_lines(self) -> None:
        """Ends all lines, because the host has lost its power."""
        for wire in self._wires.values():
            wire.close()

    def restart_board(self) -> None:
        """Restarts the board's program, as a loss of its supply does; the gate stays where it
        is."""
        truth = self.lying.truth
        self.machine.board = VirtualBoard(
            self._opening_mm if truth is None else truth.opening_mm,
            lambda: self._random.getrandbits(32),
        )

    def begin_lie(self, name: str, size: Any, lasts_s: float) -> None:
        """Begins a lie."""
        now_s = self._clock()
        self.lying.lies.append(Lie(name, size, now_s, now_s + lasts_s))

    def begin_line_fault(self, device: str, kind: str, lasts_s: float) -> None:
        """Begins a fault of a line."""
        self._faults.append((device, kind, self._clock() + lasts_s))
        self._set_line_faults()

    def advance(self, parked: bool) -> None:
        """Advances everything to the present."""
        now_s = self._clock()
        lies = self.lying.lies
        if disobeys(self.active_lies):
            self.disobeyed_s = now_s
        if lies and min(lie.end_s for lie in lies) <= now_s:
            self.lying.lies = [lie for lie in lies if lie.end_s > now_s]
        if self._faults and min(end_s for *_, end_s in self._faults) <= now_s:
            self._faults = [fault for fault in self._faults if fault[2] > now_s]
            self._set_line_faults()
        self.machine.board.driver_fault = any(lie.name == "driver_fault" for lie in self.lying.lies)
        self.lying.plant.parked = parked and self.lying.wanted_mps is None
        if now_s >= self._asked_due_s and self.asked_kg_ha is not None:
            self._asked_due_s = now_s + ASKED_PERIOD_S
            self._wires["rate_line"].write(make_target_sentence(self.asked_kg_ha))
        self.machine.advance_to(now_s)

    def replay_orders(self, lasts_s: float) -> None:
        """Sends recorded orders on the board's line again."""
        wire = self._wires["board"]
        assert isinstance(wire, BoardWire)
        wire.replays_until_s = self._clock() + lasts_s

    def pour(self, kg: float) -> None:
        """Pours product into the hopper."""
        flow = self.lying.plant._flow
        self.lying.plant._flow = flow._replace(hopper_kg=flow.hopper_kg + kg)

    @property
    def active_lies(self) -> tuple[str, ...]:
        """Names of the present lies."""
        return tuple(lie.name for lie in self.lying.lies)

    @property
    def active_faults(self) -> tuple[str, ...]:
        """Devices whose lines are faulty now."""
        return tuple(device for device, *_ in self._faults)

    def _set_line_faults(self) -> None:
        for name, wire in self._wires.items():
            found = PortFaults()
            for device, kind, _ in self._faults:
                if device == name:
                    values = LINE_FAULTS[kind]._asdict().items()
                    found = PortFaults(
                        **{field: max(value, getattr(found, field)) for field, value in values}
                    )
            wire.set_faults(found)


HEAD_NAMES = tuple(f"head_{number}" for number in range(1, 7))

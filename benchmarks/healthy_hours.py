"""Alarms in ten hours of a hard machine on which nothing is wrong: `python -m benchmarks
healthy_hours [--hours 10] [--only TEXT] [--seed 1]`

The hours are shared out to machines on ground of 0 to 8 degrees, whose load cells read the
cosine of the pitch and 0.05 to 0.3 % a degree besides. Each comes over a road, starts in the
cold with stiff grease, works with a plain receiver once a second on rough ground in wind of 2
kg, stops and goes, is filled with lots whose flow differs by up to 5 %, and somebody of 80 kg
steps up wherever it stands. Control knows none of that. Printed: alarms by kind, how often and
for how many minutes, and the stops that they brought. Exit code 1 where one is red, or where
there is more than one amber an hour.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

from rig import DAY, DT_S
from sensors_disagree import Sensors
from topdress.control.field.job import Simulated
from topdress.control.loop import ControlLoop, Tick
from topdress.control.machine.fault_injection import parse_planted
from topdress.control.orders import Do, Order, Severity, State
from topdress.control.readings import DriveCommand, Measurements
from topdress.control.simulation.assembly import add_simulated_field, make_control_loop
from topdress.control.simulation.closed_loop import simulate_run
from topdress.control.simulation.compiled_steps import COMPILED_STEPS
from topdress.control.simulation.plant import Plant, SensorReadings
from topdress.control.simulation.tractor import PathLeg, TractorPath, make_field_path
from topdress.drivers.files.run_setup import load_setup
from verdict import exit_code

ROAD_M, ROAD_KMH = 1500.0, 25.0
WORK_FROM_S = ROAD_M / (ROAD_KMH / 3.6)
SLOWED_S = 20.0  # after the road, before START
# stiff grease, % more drag, by the time, s: warm after half an hour
GREASE = ((0.0, 60.0), (300.0, 40.0), (900.0, 20.0), (1800.0, 0.0))
STOPS_EVERY_S, STOPS_FOR_S = 290.0, 25.0
SIM: dict[str, Any] = {
    "pass_length_m": 150.0,
    "passes": 800,
    "gnss_hz": 10.0,  # `Sensors` makes a plain one of it, once a second
    "roughness_deg": 1.0,
    "refill_at_kg": 40.0,
    "wind_kg": 2.0,
    "person_kg": 80.0,
    "shaking_kg_per_mps": 0.1,
    "lot_percent": 5.0,
}


class Ground(NamedTuple):
    """One machine: what its scale reads more for a degree nose up, %, and where it works."""

    slope_deg: float
    tilt_percent_per_deg: float

    @property
    def name(self) -> str:
        return f"{self.slope_deg:g} degrees, scale {self.tilt_percent_per_deg:+g} % a degree"


GROUNDS = (
    Ground(0.0, 0.3),
    Ground(2.0, -0.2),
    Ground(4.0, 0.05),
    Ground(6.0, 0.15),
    Ground(8.0, 0.3),
)


class Sensed:
    """The plant as its sensors tell it."""

    def __init__(self, plant: Plant, sensors: Callable[[SensorReadings], SensorReadings]) -> None:
        self._plant, self._sensors = plant, sensors

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def advance_plant(self, command: DriveCommand, enabled: bool) -> SensorReadings:
        return self._sensors(self._plant.advance_plant(command, enabled))


class Operated:
    """The loop, which nobody starts on the road."""

    def __init__(self, loop: ControlLoop, from_s: float) -> None:
        self._loop, self._from_s, self._now_s = loop, from_s, 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loop, name)

    def run_tick(self, m: Measurements) -> Tick:
        self._now_s = m.time_s
        return self._loop.run_tick(m)

    def handle_order(self, order: Order) -> object:
        if order.do is Do.START and self._now_s < self._from_s:
            return None
        return self._loop.handle_order(order)


class Heard(NamedTuple):
    """Of one kind of alarm on one machine."""

    severity: Severity
    times: int
    minutes: float
    first: str  # when it came first, and what it said


class Found(NamedTuple):
    heard: dict[str, Heard]
    stops: list[str]  # by an alarm: state, alarm, minute
    flowing_h: float
    trimmed_percent: float  # at most


def _speeds(seconds: float) -> list[dict[str, float]]:
    """The road, then work with stops."""
    changes = [{"at_s": 0.0, "speed_kmh": ROAD_KMH}, {"at_s": WORK_FROM_S, "speed_kmh": 4.5}]
    stop_s = WORK_FROM_S + STOPS_EVERY_S
    while stop_s < seconds:
        changes += [
            {"at_s": stop_s, "speed_kmh": 0.0},
            {"at_s": stop_s + STOPS_FOR_S, "speed_kmh": 4.5},
        ]
        stop_s += STOPS_EVERY_S + STOPS_FOR_S
    return changes


def _way(sim: Simulated, width_m: float, heading_deg: float) -> TractorPath:
    """The road, straight on into the first pass."""
    field = make_field_path(sim, width_m, heading_deg)
    first = field.find_pose(0.0)
    behind = field.find_pose(-ROAD_M)
    road = PathLeg(behind.east_m, behind.north_m, first.heading_deg, ROAD_M, 0.0)
    return TractorPath([road, *field._legs])


def driven(ground: Ground, seconds: float, seed: int) -> Found:
    """The alarms of one machine in so many seconds."""
    setup = load_setup("huanghai", "demo", DAY)
    values = setup.job.simulated.model_dump() | SIM
    values |= {"slope_deg": ground.slope_deg, "speed_changes": _speeds(seconds)}
    sim = Simulated.model_validate(values)
    job = add_simulated_field(setup.job.model_copy(update={"simulated": sim}), setup.machine)
    scale = setup.machine.scale._replace(
        tilt_percent_per_deg=ground.tilt_percent_per_deg, cosine_share=1.0
    )
    width_m, heading_deg = setup.machine.geometry.working_width_m, job.field.pass_heading_deg
    plant = Plant(
        setup.machine.model_copy(update={"scale": scale}),
        job,
        seed,
        DT_S,
        [parse_planted(f"effort.drag={percent:g}@{at_s:g}") for at_s, percent in GREASE],
        path=_way(sim, width_m, heading_deg),
        steps=COMPILED_STEPS,
    )
    loop = make_control_loop(setup.machine, setup.crop, setup.rule, job, steps=COMPILED_STEPS)
    heard: dict[str, Heard] = {}
    stops: list[str] = []
    before: set[str] = set()
    state, flowing, trimmed = str(State.OFF), 0, 0.0
    sensed: Any = Sensed(plant, Sensors(plain=True, seed=seed))
    operated: Any = Operated(loop, WORK_FROM_S + SLOWED_S)
    for step in simulate_run(sensed, operated, seconds):
        tick, minute = step.tick, step.truth.time_s / 60.0
        for alarm in tick.alarms:
            was = heard.get(alarm.id) or Heard(
                alarm.severity, 0, 0.0, f"{minute:.1f} min {dict(alarm.details)}"
            )
            heard[alarm.id] = was._replace(
                times=was.times + (alarm.id not in before), minutes=was.minutes + DT_S / 60.0
            )
        before = {alarm.id for alarm in tick.alarms}
        now, red = str(tick.row.state), [a.id for a in tick.alarms if a.severity is Severity.RED]
        if now != state and now in (State.HELD, State.FAULT, State.OFF) and red:
            stops.append(f"{now} by {red[0]} at {minute:.1f} min")
        state = now
        flowing += not tick.why_no_flow
        trimmed = max(trimmed, abs(100.0 * ((tick.row.flow_trim or 1.0) - 1.0)))
    return Found(heard, stops, flowing * DT_S / 3600.0, trimmed)


def main() -> int:
    parser = argparse.ArgumentParser(description="Alarms of a hard machine that is healthy.")
    parser.add_argument("--hours", type=float, default=10.0, help="of all machines together")
    parser.add_argument("--only", default="", help="machines whose name contains this")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    each_s = 3600.0 * given.hours / len(GROUNDS)
    grounds = [ground for ground in GROUNDS if given.only in ground.name]
    print("| machine | alarm | times | minutes | first |\n|---|---|---|---|---|")
    amber = 0
    promises: dict[str, object] = {}
    for k, ground in enumerate(grounds):
        found = driven(ground, each_s, given.seed + 10 * k)
        for alarm_id, one in found.heard.items():
            amber += one.times * (one.severity is Severity.AMBER)
            print(
                f"| {ground.name} | {alarm_id} ({one.severity}) | {one.times} | "
                f"{one.minutes:.1f} | {one.first} |"
            )
        print(
            f"| {ground.name} | {len(found.stops)} stops: {', '.join(found.stops) or 'none'} | | "
            f"{60.0 * found.flowing_h:.0f} with flow | trimmed {found.trimmed_percent:.1f} % |",
            flush=True,
        )
        red = [i for i, one in found.heard.items() if one.severity is Severity.RED]
        promises[f"{ground.name}: {', '.join(red) or 'nothing'} red"] = not red
        promises[f"{ground.name}: no stop by an alarm"] = not found.stops
        promises[f"{ground.name}: with flow for a third of it"] = found.flowing_h > each_s / 10800.0
    hours = each_s * len(grounds) / 3600.0
    promises[f"{amber} amber in {hours:.1f} h: at most one an hour"] = amber <= hours
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())

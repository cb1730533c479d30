"""Sections on a field that tapers, against the whole machine switched at once and against nothing switched.

    python -m benchmarks sections [--speed-kmh 7.2] [--strategy opening_first] [--overlap 50] [--no-valves]

The field is a wedge: 100 m long, 33.6 m wide at one end and 14.4 m at the other. Two rounds are driven along its edge
(the headland), then passes parallel to one side; they meet the slanting edge, and the headland's done ground, askew.
(`--overlap 80` is the share from which the whole machine counts as over done ground.)
Three runs at one rate: `sections` (three, with valves), `whole` (the same machine without valves: fence and done ground
switch it as one), `none` (no field and no memory of done ground; the driver lifts the work switch in the turns).

Truth is the plant's: what each section released, and where the machine was when that came down, on cells of 0.2 m; the
loop's own map of done ground is not asked. Inside the field a cell that the machine passed over and that got less than
half of what was wanted is a gap, one with more than one and a half overlap; outside, more than half of it is spread
outside. (Corners that the arcs of the turns leave out are nobody's gap.) One seed.

The exit code is 1 unless sections leave less overlap and less outside than both others, and at most half as much ground
wrong in all, gaps included. `--no-valves` takes the valves out of the run `sections`: then it must fail.
"""
from __future__ import annotations

import argparse
import datetime as dt
import sys
import time
from collections.abc import Sequence
from math import acos, atan2, cos, degrees, hypot, radians, sin, tan
from typing import Any, NamedTuple

import numpy as np
import shapely
from verdict import exit_code

from control.field.boundary import Boundary
from control.field.job import Wanted
from control.geodesy import Place, offset, turn_deg
from control.machine.landing import carried_s
from control.machine.machine import Machine
from control.machine.sections import Strip, strips
from control.orders import Do, Order, State, Strategy, TargetSource
from control.readings import DriveCommand
from control.simulation.assembly import control_loop
from control.simulation.closed_loop import Measuring
from control.simulation.plant import Plant, Truth
from control.simulation.tractor import Leg, Path, pass_order
from drivers.files.setup import Setup, load_setup

LENGTH_M, SOUTH_M, NORTH_M = 100.0, 33.6, 14.4
WEDGE: tuple[Place, ...] = ((0.0, 0.0), (0.0, LENGTH_M), (NORTH_M, LENGTH_M), (SOUTH_M, 0.0))
ROUNDS, RADIUS_M, BEYOND_M = 2, 4.0, 12.0
RATE_KG_HA, DT_S, CELL_M, POINT_M = 300.0, 0.05, 0.2, 0.05
WIDTH_M = 2.4


class Figures(NamedTuple):
    overlap_m2: float
    gap_m2: float
    outside_m2: float
    kg: float
    wanted_kg: float
    moves: int                  # of valves
    took_s: float


class Way:
    """Legs laid end to end."""

    def __init__(self, place: Place, heading_deg: float) -> None:
        self.legs: list[Leg] = []
        self.place, self.heading_deg = place, heading_deg

    def straight(self, length_m: float) -> None:
        self.legs.append(Leg(*self.place, self.heading_deg, length_m, 0.0))
        self.place = offset(self.place, self.heading_deg, length_m)

    def to_line(self, place: Place) -> None:
        """Straight on to where the way passes a place."""
        angle = radians(self.heading_deg)
        self.straight((place[0] - self.place[0]) * sin(angle) + (place[1] - self.place[1]) * cos(angle))

    def turn(self, by_deg: float, radius_m: float = RADIUS_M) -> None:
        self.legs.append(Leg(*self.place, self.heading_deg, radians(abs(by_deg)) * radius_m, by_deg))
        chord_m = 2.0 * radius_m * sin(radians(abs(by_deg)) / 2.0)
        self.place = offset(self.place, self.heading_deg + by_deg / 2.0, chord_m)
        self.heading_deg = (self.heading_deg + by_deg) % 360.0


def way_of_the_field() -> Path:
    """Round the edge, clockwise from the south-west corner, then up and down, four widths apart."""
    way = Way((0.5 * WIDTH_M, -BEYOND_M), 0.0)
    for k in range(ROUNDS):
        corners = _ring((k + 0.5) * WIDTH_M)
        for corner, following in zip(corners[1:], [*corners[2:], corners[0]], strict=True):
            _to_corner(way, corner, following)
        if k + 1 < ROUNDS:
            _to_corner(way, corners[0], corners[1])
            lane = degrees(acos(1.0 - WIDTH_M / (2.0 * 6.0)))
            way.turn(lane, 6.0)
            way.turn(-lane, 6.0)
    way.to_line((-2.0, 0.0))
    way.turn(-90.0)
    way.to_line((0.0, -BEYOND_M))
    way.turn(-90.0)
    first_m = (ROUNDS + 0.5) * WIDTH_M
    way.to_line((first_m - RADIUS_M, 0.0))
    way.turn(-90.0)
    passes = round((SOUTH_M - 2 * ROUNDS * WIDTH_M) / WIDTH_M)
    order = pass_order(passes)
    for number, k in enumerate(order):
        up = number % 2 == 0
        way.to_line((0.0, LENGTH_M + BEYOND_M if up else -BEYOND_M))
        if number + 1 < len(order):
            sideways = (order[number + 1] - k) * WIDTH_M
            way.turn(180.0 if (sideways > 0.0) == up else -180.0, abs(sideways) / 2.0)
    return Path(way.legs)


def _ring(inset_m: float) -> list[Place]:
    """Corners of the field less a margin, clockwise from the south-west."""
    ring = list(Boundary(WEDGE).inset(inset_m).rings[0])
    south_west = min(range(len(ring)), key=lambda k: hypot(*ring[k]))
    ring = ring[south_west:] + ring[:south_west]
    return ring if ring[1][1] > ring[0][1] + 1.0 else [ring[0], *reversed(ring[1:])]


def _to_corner(way: Way, corner: Place, following: Place) -> None:
    """On to a corner and round it, on an arc that touches both lines."""
    after = degrees(atan2(following[0] - corner[0], following[1] - corner[1]))
    turned = turn_deg(way.heading_deg, after)
    way.to_line(offset(corner, way.heading_deg, -RADIUS_M * tan(radians(abs(turned)) / 2.0)))
    way.turn(turned)


def run(setup: Setup, machine: Machine, strategy: Strategy, speed_kmh: float, overlap: float,
        by_hand: bool) -> tuple[list[Truth], int]:
    """The whole way driven; what truly happened, and how often valves were commanded to move."""
    field = setup.job.field.model_copy(update={"boundary_m": () if by_hand else WEDGE})
    simulated = setup.job.simulated.model_copy(update={"speed_kmh": speed_kmh})
    job = setup.job.model_copy(update={
        "target": Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=RATE_KG_HA), "strategy": strategy,
        "field": field, "simulated": simulated, "no_double": not by_hand, "section_overlap_percent": overlap})
    path, truths = way_of_the_field(), []
    plant = Plant(machine, job, 1, DT_S, path=path, keep=truths.append)
    loop = control_loop(machine, setup.crop, setup.rule, job, by_hand)
    measuring, sensed = Measuring(machine.geometry.heads), plant.step(DriveCommand(0.0, 25.0), False)
    valves: tuple[bool, ...] = ()
    moves = 0
    loop.order(Order(Do.READY))
    while truths[-1].driven_m < path.length_m:
        m = measuring.take(sensed)
        if by_hand:
            m = m._replace(work_switch=_driver_works(path, truths[-1]))
        tick = loop.tick(m)
        if tick.row.state in (State.READY, State.HELD) and (tick.sensed.speed_mps or 0.0) > 0.6:
            loop.order(Order(Do.START))
        moves += sum(one is not other for one, other in zip(tick.command.valves, valves, strict=False))
        valves = tick.command.valves
        sensed = plant.step(tick.command, tick.enabled)
    return truths, moves


def _driver_works(path: Path, truth: Truth) -> bool:
    """Down at the field's two ends and on the rounds, up in the turns beyond them."""
    return -0.5 <= truth.north_m <= LENGTH_M + 0.5 and truth.east_m > -0.5


class Landed(NamedTuple):
    """By cell, rows from the south, columns from the west."""

    kg_m2: np.ndarray
    passed: np.ndarray          # the machine was over it, whatever flowed
    west_m: float
    south_m: float


def landed(truths: Sequence[Truth], machine: Machine) -> Landed:
    """What came to lie where."""
    time_s, east, north, settled, drop = (np.array([getattr(t, name) for t in truths]) for name in (
        "time_s", "east_m", "north_m", "settled_drop_s", "drop_s"))
    heading = np.unwrap(np.radians([t.heading_deg for t in truths]))
    lands_s = time_s + carried_s(time_s, settled) + drop - settled
    place = np.column_stack([np.interp(lands_s, time_s, east), np.interp(lands_s, time_s, north)])
    course = np.interp(lands_s, time_s, heading)
    sections: tuple[Strip, ...] = machine.switched or (Strip(-0.5 * WIDTH_M, 0.5 * WIDTH_M, 1.0),)
    kg = np.array([t.section_kg or (t.flow_kg_s * DT_S,) for t in truths])
    west, south = -20.0, -30.0
    grid = np.zeros((round((LENGTH_M + 60.0) / CELL_M), round((SOUTH_M + 40.0) / CELL_M)))
    passed = np.zeros(grid.shape, dtype=np.bool_)
    across = np.arange(-0.5 * WIDTH_M + 0.5 * POINT_M, 0.5 * WIDTH_M, POINT_M)
    for shift_m in (0.0, 0.5 * CELL_M):
        ahead_e, ahead_n = (place + shift_m * np.column_stack((np.sin(course), np.cos(course)))).T
        at_e = ahead_e[:, None] + across * np.cos(course)[:, None]
        at_n = ahead_n[:, None] - across * np.sin(course)[:, None]
        passed[np.floor((at_n - south) / CELL_M).astype(int), np.floor((at_e - west) / CELL_M).astype(int)] = True
    for k, strip in enumerate(sections):
        aside = np.arange(strip.left_m + 0.5 * POINT_M, strip.right_m, POINT_M)
        for row in np.flatnonzero(kg[:-1, k] > 0.0).tolist():
            steps = max(1, round(hypot(*(place[row + 1] - place[row])) / POINT_M))
            share = (np.arange(steps) + 0.5) / steps
            middle = place[row] + share[:, None] * (place[row + 1] - place[row])
            angle = course[row] + share * (course[row + 1] - course[row])
            at_e = middle[:, :1] + aside * np.cos(angle)[:, None]
            at_n = middle[:, 1:] - aside * np.sin(angle)[:, None]
            columns = np.floor((at_e - west) / CELL_M).astype(int)
            rows = np.floor((at_n - south) / CELL_M).astype(int)
            np.add.at(grid, (rows, columns), kg[row, k] / (steps * len(aside)))
    return Landed(grid / CELL_M ** 2, passed, west, south)


def judged(truths: Sequence[Truth], moves: int, machine: Machine, took_s: float) -> Figures:
    grid, passed, west, south = landed(truths, machine)
    centres_e = west + (np.arange(grid.shape[1]) + 0.5) * CELL_M
    centres_n = south + (np.arange(grid.shape[0]) + 0.5) * CELL_M
    field = shapely.Polygon(WEDGE)
    shapely.prepare(field)
    inside = shapely.contains_xy(field, *np.meshgrid(centres_e, centres_n))
    wanted = RATE_KG_HA / 10_000.0
    cell_m2 = CELL_M ** 2
    return Figures(float((inside & (grid > 1.5 * wanted)).sum() * cell_m2),
                   float((inside & passed & (grid < 0.5 * wanted)).sum() * cell_m2),
                   float((~inside & (grid > 0.5 * wanted)).sum() * cell_m2),
                   sum(t.flow_kg_s for t in truths) * DT_S, field.area * wanted, moves, took_s)


def promises(found: dict[str, Figures]) -> dict[str, Any]:
    """Less overlap, less outside, and half as much wrong in all. A gap by itself promises nothing: who overlaps more
    leaves less of it."""
    ours, said = found["sections"], dict[str, Any]()
    for name in ("whole", "none"):
        other = found[name]
        for figure in ("overlap_m2", "outside_m2"):
            mine, theirs = getattr(ours, figure), getattr(other, figure)
            said[f"{figure} {mine:.1f} with sections: below {theirs:.1f}, {name}"] = mine < theirs
        wrong, more = (one.overlap_m2 + one.gap_m2 + one.outside_m2 for one in (ours, other))
        said[f"wrong in all {wrong:.1f} m2 with sections: at most half of {more:.1f}, {name}"] = wrong <= 0.5 * more
    return said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--speed-kmh", type=float, default=7.2)
    parser.add_argument("--strategy", default="opening_first", choices=[one.value for one in Strategy])
    parser.add_argument("--overlap", type=float, default=50.0, help="section_overlap_percent of the job")
    parser.add_argument("--no-valves", action="store_true")
    given = parser.parse_args()
    setup = load_setup("huanghai_sections", "demo", dt.date(2014, 3, 7))
    plain = setup.machine.model_copy(update={"sections": ()})
    cases = {"sections": (plain if given.no_valves else setup.machine, False), "whole": (plain, False),
             "none": (plain, True)}
    found = {}
    print(f"{len(strips(setup.machine.sections, WIDTH_M))} sections of {WIDTH_M:g} m, {given.speed_kmh:g} km/h, "
          f"{given.strategy}, overlap {given.overlap:g} %, field {shapely.Polygon(WEDGE).area:.0f} m2")
    print(f"{'':10}{'overlap m2':>12}{'gap m2':>9}{'outside m2':>12}{'kg':>8}{'wanted kg':>11}{'valve moves':>13}")
    for name, (machine, by_hand) in cases.items():
        began_s = time.perf_counter()
        truths, moves = run(setup, machine, Strategy(given.strategy), given.speed_kmh, given.overlap, by_hand)
        one = found[name] = judged(truths, moves, machine, time.perf_counter() - began_s)
        print(f"{name:10}{one.overlap_m2:12.1f}{one.gap_m2:9.1f}{one.outside_m2:12.1f}{one.kg:8.2f}{one.wanted_kg:11.2f}"
              f"{one.moves:13d}   ({one.took_s:.0f} s)", flush=True)
    sys.exit(exit_code(promises(found)))


if __name__ == "__main__":
    main()

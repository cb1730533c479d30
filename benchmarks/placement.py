"""How exactly rates and doses land: `python -m benchmarks placement [correction|oblique|point|point_loop|import|all]`.

correction  the lag paper's experiment before and after the correction, and which reading explains its table 5
oblique     straight passes across a 10 m grid through the whole loop, with and without the look-ahead
point       dose error, misses and speed limit by plant spacing: the planner alone, doses at their very moment
point_loop  the same through the whole loop on the simulated bench, doses on ticks
import      seconds and memory of large maps, look-up time per tick
"""
from __future__ import annotations

import datetime as dt
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import shapefile
from verdict import exit_code

from control.field.job import Camera, Job, Plants, Simulated, SpeedChange, Wanted
from control.geodesy import TangentPlane
from control.machine.machine import Machine
from control.machine.planting import Planted, parse_planted
from control.orders import Do, Order, Strategy, TargetSource
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import Record, simulated_run
from control.simulation.dose_watch import DoseErrors, DoseWatch
from control.simulation.errors import landing, place_errors
from control.simulation.papers.correction import READINGS, explain, misses_m, published_spread
from control.simulation.papers.published import CORRECTED_M, GAIN_M
from control.simulation.plant import Plant
from control.simulation.point_run import point_run
from control.simulation.tractor import Leg
from control.simulation.tractor import Path as Way
from control.targets.map_profile import MapProfile
from control.targets.point import fastest_mps, point_lag
from control.targets.prescription import Fallbacks, Prescription, on_plane, statistics
from control.targets.rate_map import GridMap, frame_m
from drivers.files.prescriptions.read import read_prescription
from drivers.files.setup import Setup, load_setup

CELL_M = 10.0
PASS_M = 160.0
ALONE_M = 4.0           # edges nearer to one another than this are left out: a cut corner has no half-way point
DT_S = 0.05
HIGHEST_KG_HA = 900.0   # safety refuses targets beyond 1000
CAMERA_S = 3.8          # of the way that the camera looks ahead: computing 1.5 s, lag 1.5 s, and a quarter more
SPEEDS_KMH = (3.0, 6.0, 9.0, 12.0)
SHAFTS_RPM = (10.0, 40.0, 70.0, 100.0)
HEADINGS_DEG = (8.0, 23.0, 37.0, 52.0, 61.0, 82.0)


def correction() -> dict[str, object]:
    promises: dict[str, object] = {}
    machine, rng = Machine(), np.random.default_rng(1)
    exact, in_phase = READINGS[0], next(r for r in READINGS if r.shared_phase)
    print("first granules past the boundary, m; before / after the correction")
    print("r/min   published       eq 6 exact      1 Hz position, scatter (90 % of runs)")
    for rpm, (before, after) in GAIN_M.items():
        ideal = [float(misses_m(machine, rpm, exact, on, 1, rng).mean()) for on in (False, True)]
        ours = misses_m(machine, rpm, in_phase, True, 4000, rng)
        low, high = np.percentile(ours, (5, 95))
        promises[f"{rpm} r/min: the correction makes the miss smaller"] = abs(ideal[1]) < abs(ideal[0])
        print(f"{rpm:5d}   {before:5.2f} / {after:5.2f}   {ideal[0]:5.2f} / {ideal[1]:5.2f}   "
              f"{misses_m(machine, rpm, in_phase, False, 4000, rng).mean():5.2f} / {ours.mean():5.2f} "
              f"({low:+.2f} to {high:+.2f})")
    mean, within, means = published_spread(CORRECTED_M)
    print(f"\ntable 5: mean {mean:.3f} m, s.d. of replicates {within:.3f}, of their means {means:.3f}")
    for fit in explain(machine, CORRECTED_M):
        print(f"{fit.reading.name:52} mean {fit.mean_m:6.3f}  replicates {fit.within_m:.3f}  means {fit.means_m:.3f}  "
              f"log likelihood {fit.log_likelihood:8.2f} a value")
    return promises


def oblique(pass_m: float = PASS_M) -> dict[str, object]:
    promises: dict[str, object] = {}
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    print("place error over a 10 m grid, oblique passes, m: p50 / p95 (steps, lost); speed constant | changing")
    for rpm in SHAFTS_RPM:
        for look_ahead in (False, True):
            cells = []
            for changing in (False, True):
                found = [oblique_run(setup, rpm, kmh, changing, look_ahead, k, pass_m)
                         for k, kmh in enumerate(SPEEDS_KMH)]
                cells += [f"{_cell(misses, lost)}" for misses, lost in found]
                steps, lost = sum(len(misses) for misses, _ in found), sum(lost for _, lost in found)
                promises[f"{rpm:g} r/min, look-ahead {look_ahead}, changing {changing}: {steps} steps found, "
                         f"{lost} lost: more found than lost"] = steps > lost
                cells.append("|")
            print(f"{rpm:4.0f} r/min, look-ahead {'on ' if look_ahead else 'off'}  {'  '.join(cells[:-1])}", flush=True)
    print(f"speeds {', '.join(f'{kmh:g}' for kmh in SPEEDS_KMH)} km/h; changing: 30 % down and up again within 2.5 s")
    return promises


def oblique_run(setup: Setup, shaft_rpm: float, speed_kmh: float, changing: bool, look_ahead: bool, seed: int,
                pass_m: float = PASS_M) -> tuple[np.ndarray, int]:
    """Signed place errors (k,) against the true crossings of the cells' edges, and how many steps were lost.

    Cells alternate between a low and a high rate (at least 1 : 1.5), so that every step has a half-way point to find.
    """
    machine = setup.machine.model_copy(update={
        "set_points": setup.machine.set_points.model_copy(update={"shaft_rpm": shaft_rpm})})
    speed = speed_kmh / 3.6
    rng = np.random.default_rng(seed)
    heading = HEADINGS_DEG[seed % len(HEADINGS_DEG)]
    chequered = np.indices((20, 20)).sum(axis=0) % 2
    opening_mm = np.where(chequered, rng.uniform(34.0, 44.0, (20, 20)), rng.uniform(16.0, 22.0, (20, 20)))
    flow = machine.flow.grams_per_rev_mm / 1000.0 * opening_mm * shaft_rpm / 60.0
    rates = flow * 10_000.0 / (machine.geometry.working_width_m * speed)
    rates *= min(1.0, HIGHEST_KG_HA / rates.max())
    job = Job(target=Wanted(source=TargetSource.MAP, map="made here"), look_ahead=look_ahead,
              strategy=Strategy.OPENING_FIRST,
              simulated=Simulated(speed_kmh=speed_kmh, passes=1, refill_at_kg=0.0, hopper_kg=300.0,
                                  speed_changes=_changes(speed_kmh, pass_m / speed) if changing else ()))
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    prescription = Prescription(GridMap(frame_m((-20.0, -20.0), CELL_M, CELL_M), rates), Fallbacks())
    start = (3.3, 1.7)
    way = Way([Leg(*start, heading, pass_m + 40.0, 0.0)])
    plant = Plant(machine, job, seed, DT_S, path=way)
    crop = setup.crop.model_copy(update={"max_rate_kg_ha": 1e5})
    loop = control_loop(machine, crop, setup.rule, job, prescription=MapProfile(prescription, plane))
    record = Record()
    for step in simulated_run(plant, loop, pass_m / speed + 8.0):
        record.add(step)
    columns = record.columns()
    columns["time_s"] = columns["time_s"] - DT_S                 # rows by the begin of their step, as control sees it
    columns["driven_m"] = np.concatenate(([0.0], columns["driven_m"][:-1]))
    true = [s.distance_m for s in prescription.ahead(start, heading, pass_m)][1:]
    fired = []
    for change in record.fired:
        driven = float(np.interp(change.place_m, columns["track_m"], columns["driven_m"]))
        nearest = min(true, key=lambda d: abs(d - driven), default=None)
        alone = all(d == nearest or abs(d - nearest) >= ALONE_M for d in true)
        if nearest is not None and abs(nearest - driven) < 1.0 and driven > 12.0 and alone:
            fired.append(change._replace(place_m=float(np.interp(nearest, columns["driven_m"], columns["track_m"]))))
    columns["working"] = np.ones_like(columns["working"])
    misses, lost = place_errors(columns, fired, landing(columns, machine.geometry.working_width_m),
                                machine.geometry.working_width_m)
    return misses, lost


def _changes(speed_kmh: float, lasts_s: float) -> tuple[SpeedChange, ...]:
    """30 % slower and back, again and again, as fast as a tractor's pedal does."""
    hard = 0.3 * speed_kmh / 3.6 / 2.5
    found = [SpeedChange(at_s=0.0, speed_kmh=speed_kmh)]
    for k, at in enumerate(np.arange(12.0, lasts_s + 8.0, 6.0)):
        found.append(SpeedChange(at_s=float(at), speed_kmh=speed_kmh * (0.7 if k % 2 == 0 else 1.0),
                                 acceleration_mps2=hard))
    return tuple(found)


def _cell(misses: np.ndarray, lost: int) -> str:
    if not len(misses):
        return f"none ({lost} lost)"
    p50, p95 = np.percentile(np.abs(misses), (50, 95))
    return f"{p50:.2f}/{p95:.2f} ({len(misses)},{lost})"


def point(plants: int = 300) -> dict[str, object]:
    promises: dict[str, object] = {}
    lag = point_lag(120.0, 99.8, 1.0)
    print(f"one dose: {lag.link_s:.2f} s link, {lag.turn_s:.2f} s turning, {lag.fall_s:.2f} s falling")
    print("dose error p50 / p95, m, and doses missed, without and with the learned threshold; after 100 doses")
    for spacing in (0.2, 0.25, 0.3):
        print(f"spacing {spacing:.2f} m: limit {fastest_mps(spacing, lag.turn_s):.2f} m/s")
        for speed in (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0):
            cells = []
            for learn in (False, True):
                run = point_run(lag, spacing, speed, plants, 1, learn)
                size = np.abs(run.error_m[min(100, len(run.error_m) // 2):])
                missed = 100.0 * run.missed / plants
                promises[f"spacing {spacing:g} m, {speed:g} m/s: doses were given"] = len(run.error_m) > 0
                cells.append(f"{np.median(size):.3f} / {np.percentile(size, 95):.3f}, {missed:4.1f} %")
            print(f"  {speed:4.2f} m/s   {'     '.join(cells)}")
    return promises


def point_loop(plants: int = 300, hz: float = 20.0) -> dict[str, object]:
    """On the shipped bench, with 0.1 s and 0.05 s that control does not know; the camera as far ahead as each speed
    needs (farther, and the way until the dose is counted wrongly by more)."""
    promises: dict[str, object] = {}
    setup = load_setup("bench", "points_demo", dt.date(2026, 5, 1))
    planted = [parse_planted(text) for text in ("shaft.dead_time=0.1", "lag.offset=0.05")]
    print(f"whole loop at {hz:g} Hz: dose error p50 / p95, m, and plants missed, without and with the learned "
          "threshold; after 100 doses")
    for spacing in (0.2, 0.25, 0.3):
        turn_s = setup.job.target.dose_angle_deg / (6.0 * setup.machine.set_points.shaft_rpm)
        busy_s = float(np.ceil((turn_s + setup.job.target.dose_rest_s) * hz - 1e-6)) / hz
        print(f"spacing {spacing:.2f} m: limit {spacing / turn_s:.2f} m/s by the shaft alone, {spacing / busy_s:.2f} "
              f"m/s with a pause of {setup.job.target.dose_rest_s:g} s, on ticks")
        for speed in (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0):
            cells = []
            for learn in (False, True):
                found = point_loop_run(setup, planted, spacing, speed, learn, plants, hz)
                share = 100.0 * found.missed / max(1, found.plants)
                promises[f"spacing {spacing:g} m, {speed:g} m/s: plants were there, doses were given"] = (
                    found.plants > found.missed)
                cells.append(f"{found.p50_m:.3f} / {found.p95_m:.3f}, {share:4.1f} %")
            print(f"  {speed:4.2f} m/s   {'     '.join(cells)}", flush=True)
    return promises


def point_loop_run(setup: Setup, planted: list[Planted], spacing_m: float, speed_mps: float, learn: bool, plants: int,
                   hz: float) -> DoseErrors:
    sim = setup.job.simulated.model_copy(update={
        "speed_kmh": 3.6 * speed_mps, "plants": Plants(spacing_m=spacing_m),
        "camera": Camera(ahead_m=CAMERA_S * speed_mps + 0.5),
        "pass_length_m": plants * spacing_m, "passes": 1, "run_in_m": 16.0})
    target = setup.job.target.model_copy(update={"learn_threshold": learn})
    job = with_simulated_field(setup.job.model_copy(update={"simulated": sim, "target": target}), setup.machine)
    plant = simulated_machine(setup.machine, job, 1, 1.0 / hz, planted)
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    watch = DoseWatch(plant.plants_m, 4, sim.dose_measured_sd_m)
    orders = [(2.0, Order(Do.READY)), (2.1, Order(Do.START))]
    for _ in simulated_run(plant, loop, (plants * spacing_m + 20.0) / speed_mps + 6.0, orders, watch):
        pass
    return watch.errors(settle=100)


def large_maps() -> dict[str, object]:
    promises: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as folder:
        cells, zones = Path(folder) / "cells", Path(folder) / "zones.shp"
        _write_grid(cells, 500, 500)
        _write_zones(zones, 141, 142)
        for name, path in (("grid of 250,000 cells (ISOXML type 2)", cells), ("20,022 polygons (shapefile)", zones)):
            started = time.process_time()
            read = read_prescription(path)
            read_s = time.process_time() - started
            plane = read.data.plane()
            started = time.process_time()
            prescription = on_plane(read.data, plane)
            laid_s = time.process_time() - started
            profile = MapProfile(prescription, plane)
            started = time.process_time()
            for k in range(400):
                profile.look(0.1 * k, -100.0 + 0.03 * k, -100.0 + 0.095 * k, 17.5, 0.1 * k - 5.0)
            promises[f"{name}: some cell has a rate"] = sum(s.mass_kg for s in statistics(read.data)) > 0.0
            look_us = (time.process_time() - started) / 400 * 1e6
            peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            print(f"{name}: read {read_s:.2f} s of CPU, laid on the plane {laid_s:.2f} s, look {look_us:.0f} us a "
                  f"tick, peak memory so far {peak_mb:.0f} MB")
    return promises


def _write_grid(folder: Path, rows: int, columns: int) -> None:
    folder.mkdir()
    rng = np.random.default_rng(1)
    (folder / "GRD00001.bin").write_bytes(rng.integers(5000, 40_000, rows * columns).astype("<i4").tobytes())
    (folder / "TASKDATA.XML").write_text(
        '<ISO11783_TaskData VersionMajor="4" VersionMinor="3" DataTransferOrigin="1"><TSK A="TSK1" G="1" H="0" I="0" '
        f'J="0"><TZN A="0"><PDV A="0006" B="0"/></TZN><GRD A="34.28" B="119.88" C="0.000045" D="0.000054" '
        f'E="{columns}" F="{rows}" G="GRD00001" I="2" J="0"/></TSK></ISO11783_TaskData>')


def _write_zones(path: Path, rows: int, columns: int) -> None:
    rng = np.random.default_rng(1)
    with shapefile.Writer(str(path), shapeType=shapefile.POLYGON) as writer:
        writer.field("rate", "N", 10, 2)
        for i in range(rows):
            for j in range(columns):
                south, west = 34.28 + i * 7e-5, 119.88 + j * 1e-4
                writer.poly([[(west, south), (west, south + 7e-5), (west + 1e-4, south + 7e-5),
                              (west + 1.1e-4, south + 3e-5), (west + 1e-4, south), (west, south)]])
                writer.record(float(rng.uniform(50, 400)))


ALL = {"correction": correction, "oblique": oblique, "point": point, "point_loop": point_loop, "import": large_maps}

if __name__ == "__main__":
    asked = list(ALL) if sys.argv[1:] in ([], ["all"]) else sys.argv[1:]
    if unknown := [word for word in asked if word not in ALL]:
        sys.exit(f"{unknown[0]}: allowed: all, {', '.join(ALL)}")
    kept: dict[str, object] = {}
    for wanted in asked:
        print(f"\n== {wanted}")
        kept |= ALL[wanted]()
    sys.exit(exit_code(kept))

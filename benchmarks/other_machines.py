"""How good control is where the machine is not its model: `python benchmarks/other_machines.py
--against /old/tree`

Control has the shipped machine file. What is driven is one of
`control.machine.parameter_uncertainty`: nobody's tables settle what goes on in the tube, and
drives, flow and field lag are never quite the file's. Nothing on the machine sees the ground,
so machines that differ in the tube alone are driven once, and landed each its own way.

Printed are, mean over seeds: rate error as it fell, and with the best constant shift along the
way (what a lag test on this machine would have taken away); place error likewise; and for each
strategy the mean and the worst of all machines.

--against: the same with the control of another tree, in the same run. Exit code 1 where a
promise breaks.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from manoeuvres import DT_S, GO, GO_HELD, MANOEUVRES, Manoeuvre, sim_of, the_setup
from topdress.control.field.job import Simulated
from topdress.control.machine.fault_injection import InjectedEffect
from topdress.control.machine.machine import Machine
from topdress.control.orders import Do, Order, Strategy, TargetSource
from topdress.control.readings import DriveCommand
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.control.simulation.error_metrics import find_landing, find_place_errors
from topdress.control.simulation.plant import Plant, PlantTruth, SensorReadings
from topdress.control.simulation.strategy_figures import count_moves
from topdress.control.targets.map_profile import MapProfile
from topdress.control.targets.prescription import Fallbacks, Prescription
from topdress.control.targets.rate_map import GridMap, make_frame_m
from topdress.drivers.files.run_setup import Setup
from verdict import exit_code

# Nothing else: driven once. standing_free: carried along, but a standing shaft does not slow
# what falls.
STANDING_FREE = "standing_free"
IN_THE_TUBE = (
    "carried_along",
    "singly",
    "between",
    "first_fill_half",
    "first_fill_all",
    STANDING_FREE,
    "field_lag",
)
ENDS, END_M = "pass ends, last 8 m", 8.0
STEADY, ZONES = "steady 4.5 km/h, from the second minute on", "map, abrupt zones"
OUT = "map, GNSS silent for 6 s"
BY_MAP = (ZONES, OUT)
OUTAGES_S = {OUT: (45.0, 51.0)}
DEAD_FROM_S = 60.0
ZONE_M = 15.0
ZONES_KG_HA = (300.0, 450.0, 150.0, 400.0, 200.0, 330.0, 120.0, 450.0)
OF_OLD = {m.name: m for m in MANOEUVRES}
DRIVEN = (
    Manoeuvre(STEADY, 100, 145, ()),
    OF_OLD["accelerating 3 to 7 km/h, 0.5 m/s2"],
    OF_OLD["decelerating 7 to 3 km/h, 0.5 m/s2"],
    Manoeuvre(ZONES, 20, 90, ()),
    Manoeuvre(OUT, 40, 60, ()),
    OF_OLD["stop and go, 6 s standing"],
    Manoeuvre(ENDS, 20, 200, (), {"pass_length_m": 60.0}, True),
)
SHIFTS_M = np.arange(-1.2, 1.2001, 0.05)
PROMISED_FROM = 3  # seeds
# of the carried share, after ten steps from 40 to 80 r/min
TESTED_SD = 0.05
HEAD = (
    f"{'manoeuvre':43}{'strategy':14}{'preview':8}{'machine':15}{'held %':>8}{'shifted':>9}"
    f"{'shift m':>9}"
    f"{'place m':>9}{'shifted':>9}{'p95':>7}{'steps':>6}{'lost':>5}{'worst bin':>11}{'bare m':>8}"
    f"{'bias %':>8}{'mean':>7}{'gate/min':>9}{'mm/min':>8}"
)


TEETH_PERCENT = {"teeth_2": 2.0, "teeth_4": 4.0}
NOISY = ("wheel_0.02", "wheel_0.03", "wheel_0.04", "wheel_0.06", *TEETH_PERCENT)
# A driven wheel on wet and dry ground by turns of 20 s: 6 to 9 % are published, twice that
# where it is wet.
BURSTS = [
    ("speed.wheel_slip", 15.0 if turn % 2 == 0 else 0.0, 40.0 + 20.0 * turn) for turn in range(6)
]
SPEEDS = ("slip_bursts", "gnss_late", "slip_bursts_gnss_late")
# A battery that goes flat by and by: at once, more than 20 % below its model is a fault.
OUTAGES = ("dead_wheel",)
DRIVES = ("motor_12_slow", "motor_25_slow", "gate_4_short")
PLANTED = {
    "slip_bursts": BURSTS,
    "slip_bursts_gnss_late": BURSTS,
    "motor_25_slow": [("shaft.gain", -12.0, 30.0), ("shaft.gain", -25.0, 60.0)],
}
LATE_S = 0.4


def any_machine(machine: Machine, name: str) -> Machine:
    """A plausible one, or one whose senses of speed are worse (`NOISY`, `SPEEDS`)."""
    from topdress.control.machine.machine import add_effect
    from topdress.control.machine.parameter_uncertainty import make_plausible_machine

    if name.startswith("wheel_"):
        return machine.model_copy(
            update={"noise": machine.noise.model_copy(update={"wheel_mps": float(name[6:])})}
        )
    if name.endswith("gnss_late"):
        return add_effect(machine, "speed.gnss_latency", LATE_S)
    return (
        machine
        if name in TEETH_PERCENT or name in (*PLANTED, *OUTAGES, STANDING_FREE)
        else make_plausible_machine(machine, name)
    )


class Drive(NamedTuple):
    """One run that a tree is to make. `machine`: what is simulated, as its file has it."""

    manoeuvre: str
    strategy: str
    preview: str
    seed: int
    machine: dict[str, Any]
    drives: str  # name of what differs in drives and flow
    # the tube as control's machine file has it, and how sure that is; none: as shipped
    known: dict[str, Any]
    planted: list[Any] = []  # `InjectedEffect`: effects that come and go
    teeth_percent: float = 0.0  # 1 s.d. by which the wheel's teeth are uneven


class Found(NamedTuple):
    """One manoeuvre, one strategy, one machine, over all seeds."""

    tree: str
    manoeuvre: str
    strategy: str
    preview: str
    machine: str
    held_percent: float
    shifted_percent: float  # with the best constant shift
    shift_m: float
    place_m: float
    shifted_place_m: float  # about its own median
    place_p95_m: float
    steps: int
    lost: int
    worst_kg_ha: float  # landed on a bin
    # of the way: below a tenth of what was wanted, a run
    bare_m: float
    bias_percent: float
    worst_mean_kg_ha: float  # of the worst bins, a run
    gate_moves_per_min: float
    gate_mm_per_min: float

    def line(self) -> str:
        preview = self.preview if self.tree == "new" else self.tree
        return (
            f"{self.manoeuvre:43}{self.strategy:14}{preview:8}{self.machine:15}"
            f"{self.held_percent:8.2f}"
            f"{self.shifted_percent:9.2f}{self.shift_m:+9.2f}{self.place_m:9.3f}"
            f"{self.shifted_place_m:9.3f}"
            f"{self.place_p95_m:7.3f}{self.steps:6d}{self.lost:5d}{self.worst_kg_ha:11.0f}"
            f"{self.bare_m:8.2f}"
            f"{self.bias_percent:+8.1f}{self.worst_mean_kg_ha:7.0f}"
            f"{self.gate_moves_per_min:9.0f}{self.gate_mm_per_min:8.0f}"
        )


class OtherSenses:
    """A plant whose wheel reads each tooth by its own error (over a turn they come to nothing),
    or gives no pulse from a moment on; whose GNSS is silent for a while."""

    def __init__(self, plant: Plant, what: Drive) -> None:
        self.plant, self.machine, self.dt_s = plant, plant.machine, plant.dt_s
        self._dead_s = DEAD_FROM_S if what.drives == "dead_wheel" else np.inf
        self._out_s = OUTAGES_S.get(what.manoeuvre, (np.inf, np.inf))
        speed = plant.machine.speed
        self._tooth_m = speed.wheel_circumference_m / speed.pulses_per_turn
        errors = np.random.default_rng(what.seed).normal(
            0.0, what.teeth_percent / 100.0, round(speed.pulses_per_turn)
        )
        self._errors = (errors - errors.mean()).tolist()

    @property
    def truth(self) -> PlantTruth | None:
        return self.plant.truth

    def advance_plant(self, command: DriveCommand, enabled: bool) -> SensorReadings:
        s = self.plant.advance_plant(command, enabled)
        assert self.truth is not None
        tooth = int(self.truth.driven_m / self._tooth_m) % len(self._errors)
        wheel_mps = (
            0.0 if s.time_s >= self._dead_s else s.wheel_speed_mps * (1.0 + self._errors[tooth])
        )
        silent = self._out_s[0] <= s.time_s < self._out_s[1]
        return s._replace(wheel_speed_mps=wheel_mps, gnss=None if silent else s.gnss)


def drive(what: Drive) -> tuple[dict[str, Any], list[Any]]:
    """Columns of `Record` and the changes made; works with trees that know nothing of this
    benchmark."""
    setup, manoeuvre = _knowing(what.known), next(m for m in DRIVEN if m.name == what.manoeuvre)
    sim = setup.job.simulated.model_dump() | sim_of(manoeuvre)
    if what.drives == "dead_wheel":
        sim["gnss_hz"] = 10.0
    if what.preview != "none":
        sim["speed_told"] = what.preview
    update: dict[str, Any] = {
        "strategy": Strategy(what.strategy),
        "simulated": Simulated.model_validate(sim),
    }
    profile = None
    if what.manoeuvre in BY_MAP:
        update["target"] = setup.job.target.model_copy(
            update={"source": TargetSource.MAP, "map": "made here"}
        )
    job = add_simulated_field(setup.job.model_copy(update=update), setup.machine)
    if what.manoeuvre in BY_MAP:
        setup_plane = make_control_loop(setup.machine, setup.crop, setup.rule, setup.job).plane
        rates = np.resize(ZONES_KG_HA, (24, 1))
        grid = GridMap(make_frame_m((-50.0, -ZONE_M), 600.0, ZONE_M), rates)
        from topdress.control.geodesy import TangentPlane

        profile = MapProfile(
            Prescription(grid, Fallbacks()),
            setup_plane or TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg),
        )
    plant: Any = OtherSenses(
        make_plant(
            _of_this_tree(what.machine),
            job,
            what.seed,
            DT_S,
            [InjectedEffect(*one) for one in what.planted],
        ),
        what,
    )
    loop = make_control_loop(setup.machine, setup.crop, setup.rule, job, prescription=profile)
    record = RunRecord()
    orders = GO_HELD if manoeuvre.speeds and manoeuvre.speeds[0][1] == 0 else None
    if what.drives == "dead_wheel":
        orders = (*GO, (DEAD_FROM_S + 3.0, Order(Do.ACKNOWLEDGE, "")))
        if hasattr(Do, "ALLOW_NO_WHEEL"):
            orders += ((DEAD_FROM_S + 3.0, Order(Do.ALLOW_NO_WHEEL, True)),)
    for step in simulate_run(plant, loop, manoeuvre.end_s + 4.0, orders):
        record.add_tick(step)
    return record.make_columns(), record.fired


def _of_this_tree(published: dict[str, Any]) -> Machine:
    """Keys that an older tree does not know are left out: its machine has no such thing
    (`shaft.one_way`: all its shafts turn one way)."""
    plain, known = Machine(), dict[str, Any]()
    for name, value in published.items():
        fields = getattr(getattr(plain, name, None), "_fields", None)
        if name in Machine.model_fields:
            known[name] = (
                value
                if fields is None
                else {key: own for key, own in value.items() if key in fields}
            )
    return Machine.model_validate(known)


def _knowing(known: dict[str, Any]) -> Setup:
    """The shipped set-up, with what a lag test between two rates found in its machine file."""
    setup = the_setup()
    if not known:
        return setup
    machine = setup.machine.model_copy(
        update={
            "fall": setup.machine.fall._replace(**known["fall"]),
            "tolerance": setup.machine.tolerance.model_copy(update={"carried_share": known["sd"]}),
        }
    )
    return replace(setup, machine=machine)


def relanded(columns: dict[str, Any], machine: Machine, free: bool = False) -> dict[str, Any]:
    """The same run, fallen through another tube. free: from the command to stop on the pace
    stays."""
    from topdress.control.machine.fall import calc_drop_s

    rpm = columns["shaft_rpm"]
    if free:
        commanded = columns["shaft_rpm_cmd"] > 0.0
        rpm = rpm[np.maximum.accumulate(np.where(commanded, np.arange(len(rpm)), 0))]
    settled = np.array([calc_drop_s(machine.fall, n) for n in rpm.tolist()])
    return columns | {
        "settled_drop_s": settled,
        "drop_s": settled + machine.fall.latency_s,
        "carried_share": np.full(len(settled), machine.fall.carried_share),
    }


class Judged(NamedTuple):
    held: float
    by_shift: Any  # held % by SHIFTS_M
    places_m: Any
    lost: int
    worst_kg_ha: float
    bare_m: float
    bias_percent: float
    gate_moves_per_min: float
    gate_mm_per_min: float


def judge(columns: dict[str, Any], fired: Sequence[Any], what: Manoeuvre, width_m: float) -> Judged:
    time_s, way = columns["time_s"], columns["driven_m"]
    rows = (time_s >= what.begin_s) & (time_s <= what.end_s)

    def of(shift_m: float) -> tuple[float, float, float, float]:
        land = find_landing(columns, width_m, shift_m)
        centres = land.ground.calc_centres_m()
        inside = (land.inside > 0.0) & (centres >= way[rows].min()) & (centres <= way[rows].max())
        if what.edges:
            ends = centres[:-1][np.diff(land.inside) < 0.0]
            inside &= np.any((ends[:, None] >= centres) & (centres > ends[:, None] - END_M), axis=0)
        got, target = land.landed_kg_ha[inside], land.target_kg_ha[inside]
        return (
            100.0 * float(np.abs(got - target).sum() / max(1e-9, target.sum())),
            float(got.max(initial=0.0)),
            0.25 * float((got < 0.1 * target).sum()),
            100.0 * float((got - target).sum() / max(1e-9, target.sum())),
        )

    held, worst, bare, bias = of(0.0)
    chosen = [f for f in fired if what.begin_s <= f.time_s <= what.end_s]
    places, lost = find_place_errors(columns, chosen, find_landing(columns, width_m), width_m)
    moved = count_moves({name: column[rows] for name, column in columns.items()}, [], width_m)
    each = [of(shift) for shift in SHIFTS_M]
    return Judged(
        held,
        np.array([one[0] for one in each]),
        places,
        lost,
        worst,
        bare,
        bias,
        moved.gate_moves_per_h / 60.0,
        moved.gate_travel_mm_per_h / 60.0,
    )


def found(
    tree: str, manoeuvre: str, strategy: str, preview: str, machine: str, each: Sequence[Judged]
) -> Found:
    # one shift for all seeds: it is the machine's
    by_shift = np.mean([one.by_shift for one in each], axis=0)
    best = int(np.argmin(by_shift))
    places = np.concatenate([one.places_m for one in each])
    size = np.abs(places) if len(places) else np.full(1, np.nan)
    about = np.abs(places - np.median(places)) if len(places) else np.full(1, np.nan)
    return Found(
        tree,
        manoeuvre,
        strategy,
        preview,
        machine,
        statistics.fmean(one.held for one in each),
        float(by_shift[best]),
        float(SHIFTS_M[best]),
        float(size.mean()),
        float(about.mean()),
        float(np.percentile(about, 95)),
        len(places),
        sum(one.lost for one in each),
        max(one.worst_kg_ha for one in each),
        statistics.fmean(one.bare_m for one in each),
        statistics.fmean(one.bias_percent for one in each),
        statistics.fmean(one.worst_kg_ha for one in each),
        statistics.fmean(one.gate_moves_per_min for one in each),
        statistics.fmean(one.gate_mm_per_min for one in each),
    )


def driven_by(tree: Path | None, drives: Sequence[Drive]) -> list[tuple[dict[str, Any], list[Any]]]:
    """Every drive with the control of a tree; None: this one."""
    if tree is None:
        return [drive(one) for one in drives]
    here = Path(__file__).resolve()
    environment = os.environ | {"PYTHONPATH": f"{tree}{os.pathsep}{here.parent}"}
    with tempfile.TemporaryDirectory() as folder:
        asked, got = Path(folder) / "asked.json", Path(folder) / "got.pickle"
        asked.write_text(json.dumps([one._asdict() for one in drives]), encoding="utf-8")
        subprocess.run(
            [sys.executable, str(here), "--drive", str(asked), str(got)],
            env=environment,
            cwd=tree,
            check=True,
        )
        return list(pickle.loads(got.read_bytes()))


def measured(
    manoeuvres: Sequence[Manoeuvre],
    strategies: Sequence[str],
    preview: str,
    machines: Sequence[str],
    seeds: int,
    tree: Path | None,
    lag_tested: bool = False,
) -> Iterator[Found]:
    setup = the_setup()
    width_m = setup.machine.geometry.working_width_m
    true = {name: any_machine(setup.machine, name) for name in machines}
    for what in manoeuvres:
        for strategy in strategies:
            kinds = {
                name: "file" if name in IN_THE_TUBE and not lag_tested else name
                for name in machines
            }
            drives = [
                Drive(
                    what.name,
                    strategy,
                    preview,
                    seed,
                    _known_to_all(machine),
                    kind,
                    _tested(machine, lag_tested),
                    PLANTED.get(kind, []),
                    TEETH_PERCENT.get(kind, 0.0),
                )
                for kind, machine in {kinds[name]: true[name] for name in machines}.items()
                for seed in range(1, seeds + 1)
            ]
            runs: dict[str, list[tuple[dict[str, Any], list[Any]]]] = {}
            for one, run in zip(drives, driven_by(tree, drives), strict=True):
                runs.setdefault(one.drives, []).append(run)
            for name in machines:
                each = [
                    judge(
                        relanded(columns, true[name], name == STANDING_FREE), fired, what, width_m
                    )
                    for columns, fired in runs[kinds[name]]
                ]
                yield found(
                    "new" if tree is None else "old",
                    what.name,
                    strategy,
                    "tested" if lag_tested else preview,
                    name,
                    each,
                )


def _tested(machine: Machine, lag_tested: bool) -> dict[str, Any]:
    """What control's file says of the tube after a lag test between two rates on this machine."""
    return {"fall": machine.fall._asdict(), "sd": TESTED_SD} if lag_tested else {}


def _known_to_all(machine: Machine) -> dict[str, Any]:
    """The file of the machine's drives and flow, of each part what is not as it comes by
    itself: a tree that knows fewer keys reads it too. Its tube is left to the landing."""
    plain, published = Machine(), dict[str, Any]()
    values = machine.model_dump(
        mode="json", exclude={"fall", "tolerance", "set_points"}, exclude_defaults=True
    )
    for name, value in values.items():
        part, usual = getattr(machine, name), getattr(plain, name)
        if hasattr(part, "_asdict"):
            value = {key: own for key, own in part._asdict().items() if own != getattr(usual, key)}
        published[name] = value
    return published


def summary(all_found: Sequence[Found]) -> Iterator[str]:
    """By manoeuvre and strategy: mean and worst of the machines."""
    yield (
        f"\n{'manoeuvre':43}{'strategy':14}{'preview':8}{'held % mean':>12}{'worst':>8}"
        f"{'shifted mean':>14}"
        f"{'worst':>8}  {'of':15}{'place mean':>11}{'worst':>8}{'shifted mean':>14}{'worst':>8}"
    )
    groups: dict[tuple[str, str, str, str], list[Found]] = {}
    for f in all_found:
        groups.setdefault((f.manoeuvre, f.strategy, f.tree, f.preview), []).append(f)
    for (manoeuvre, strategy, tree, preview), of in groups.items():
        worst = max(of, key=lambda f: f.shifted_percent)
        yield (
            f"{manoeuvre:43}{strategy:14}{preview if tree == 'new' else tree:8}"
            f"{statistics.fmean(f.held_percent for f in of):12.2f}"
            f"{max(f.held_percent for f in of):8.2f}"
            f"{statistics.fmean(f.shifted_percent for f in of):14.2f}{worst.shifted_percent:8.2f}  "
            f"{worst.machine:15}{statistics.fmean(f.place_m for f in of):11.3f}"
            f"{max(f.place_m for f in of):8.3f}"
            f"{statistics.fmean(f.shifted_place_m for f in of):14.3f}"
            f"{max(f.shifted_place_m for f in of):8.3f}"
        )


def promises(all_found: Sequence[Found], seeds: int) -> dict[str, object]:
    kept: dict[str, object] = {"something was measured": len(all_found) > 0}
    for f in all_found:
        if f.tree != "new" or seeds < PROMISED_FROM:
            continue
        who = f"{f.manoeuvre}, {f.strategy}, {f.machine}, preview {f.preview}"
        promised = PROMISED_IN_FIELD_PERCENT if f.machine == "field_lag" else PROMISED_PERCENT
        rate = promised.get((f.manoeuvre, f.strategy))
        place = PROMISED_M.get((f.manoeuvre, f.strategy))
        if rate is not None:
            kept[f"{who}: rate error {f.shifted_percent:.2f} %: at most {rate:g} %"] = (
                f.shifted_percent <= rate
            )
        if place is not None:
            kept[f"{who}: place error {f.shifted_place_m:.3f} m: at most {place:g} m"] = (
                f.shifted_place_m <= place
            )
    return kept


# A gate alone leaves some 9 % of an acceleration that is seen without delay, 12 % with 0.3 s
# more of lag (docs/decisions/0007-the-tube-is-unsettled.md); what there is above it is the
# delay.
PROMISED_PERCENT = {
    (STEADY, "opening_first"): 2.0,
    ("accelerating 3 to 7 km/h, 0.5 m/s2", "opening_first"): 11.0,
}
PROMISED_IN_FIELD_PERCENT = {
    **PROMISED_PERCENT,
    ("accelerating 3 to 7 km/h, 0.5 m/s2", "opening_first"): 13.5,
}
PROMISED_M = {(ZONES, "opening_first"): 0.06, (ZONES, "speed_first"): 0.15}


def run() -> int:
    from topdress.control.machine.parameter_uncertainty import PLAUSIBLE_MACHINES

    parser = argparse.ArgumentParser(
        description="Rate and place error where the machine is not its model."
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--only", default="", help="manoeuvres whose name contains one of these, comma separated"
    )
    parser.add_argument("--strategies", default="opening_first,speed_first")
    parser.add_argument(
        "--machines",
        default=",".join((*PLAUSIBLE_MACHINES, STANDING_FREE)),
        help=f"also noisy ({', '.join(NOISY)}), speeds ({', '.join(SPEEDS)}) and drives "
        f"({', '.join(DRIVES)})",
    )
    parser.add_argument("--preview", default="none", help="none, set, plan, drive; comma separated")
    parser.add_argument(
        "--against", type=Path, help="another tree, measured in the same run, nothing announced"
    )
    parser.add_argument(
        "--tested",
        action="store_true",
        help="also with a machine file that a lag test between two rates has put right",
    )
    parser.add_argument("--out", type=Path, help="write the lines there too")
    given = parser.parse_args()
    chosen = [m for m in DRIVEN if any(word in m.name for word in given.only.split(","))]
    groups = {"outages": OUTAGES, "noisy": NOISY, "speeds": SPEEDS, "drives": DRIVES}
    strategies = given.strategies.split(",")
    machines = [name for word in given.machines.split(",") for name in groups.get(word, (word,))]
    trees = [(given.against, "none")] if given.against is not None else []
    trees += [(None, preview) for preview in given.preview.split(",")]
    trees += [(None, "tested")] if given.tested else []
    lines, all_found = [HEAD], list[Found]()
    print(HEAD)
    for tree, preview in trees:
        for one in measured(
            chosen,
            strategies,
            "none" if preview == "tested" else preview,
            machines,
            given.seeds,
            tree,
            preview == "tested",
        ):
            all_found.append(one)
            lines.append(one.line())
            print(lines[-1], flush=True)
    for line in summary(all_found):
        lines.append(line)
        print(line)
    if given.out:
        given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return exit_code(promises(all_found, given.seeds))


def _drive_all(asked: Path, got: Path) -> None:
    drives = [Drive(**one) for one in json.loads(asked.read_text(encoding="utf-8"))]
    got.write_bytes(pickle.dumps([drive(one) for one in drives]))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--drive"]:
        _drive_all(Path(sys.argv[2]), Path(sys.argv[3]))
        sys.exit(0)
    sys.exit(run())

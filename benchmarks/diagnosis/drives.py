"""Every recording of a real drive: what a diagnosis says of it, and whether the file made of it
predicts the next.

    python benchmarks/diagnosis/drives.py --out drives.json [--only sweep] [--no-rival] \\
        [--against OLD.json]

The recordings are strangers' (../shared/data/drives; without them nothing is run). Each wheel,
motor and direction is a case: imported with an import file, diagnosed against a machine file
with what a data sheet says, adopted. What is there by eye stands in `CASES`; nothing is fitted
to that. Then pairs: fitted to one recording, judged on every row of another of the same machine
or kind, as the nominal machine file, the adopted one, and a rival (least squares over eight
forms of the command, a lag, a dead time: ../shared/prototypes/drive_peer) predict it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]

import numpy as np  # noqa: E402
import yaml  # noqa: E402

SHARED = ROOT.parent / "shared"
DRIVES = SHARED / "data" / "drives"
KNOWN = SHARED / "data" / "known_causes"
VALVES = SHARED / "data" / "valves"
PEER = SHARED / "prototypes" / "drive_peer" / "peer.py"

# What a data sheet says of each machine: full speed in r/min at the full command, times in s,
# noise of the reading.
GEAR_MOTOR = {"full_rpm": 650.0, "tau_s": 0.06, "dead_s": 0.02, "noise_rpm": 2.0}
# 0.46 rad/s a count
FOOTBALL = {"full_rpm": 1500.0, "tau_s": 0.10, "dead_s": 0.01, "noise_rpm": 4.4}
# 0.23 rad/s a count
WHEEL_IN_AIR = {"full_rpm": 600.0, "tau_s": 0.10, "dead_s": 0.01, "noise_rpm": 2.2}
# 0.18 rad/s a count
SWEPT = {"full_rpm": 1050.0, "tau_s": 0.10, "dead_s": 0.01, "noise_rpm": 1.8}
BRAKED = {"full_rpm": 1800.0, "tau_s": 0.05, "dead_s": 0.01, "noise_rpm": 10.0}
# 6.43 deg/s a count; read as r/min: 1 for each 6 deg/s
DC_MOTOR = {"full_rpm": 81.0, "tau_s": 0.05, "dead_s": 0.0, "noise_rpm": 0.31}
# degrees above the room for r/min
HEATER = {"full_rpm": 70.0, "tau_s": 5.0, "dead_s": 5.0, "noise_rpm": 0.1}
THRUSTER = {"full_rpm": 3800.0, "tau_s": 0.10, "dead_s": 0.01, "noise_rpm": 5.0, "supply_v": 20.0}
ACTUATOR = {"slew_mm_s": 200.0, "noise_mm": 0.05}

ZONE, CURVE, GAIN, SLOW, SIDES = "dead zone", "curve", "gain", "slow", "two sides"
BRAKE, SUPPLY, PLAY, LEVEL, OTHER = "brake", "supply", "play", "level", "other side"
STICKS = "sticks"
# Names and terms that say each of them. A curve over the command is said by a term over it; two
# that stand for each other over half of a range are not told apart by eye either.
FORMS = ("slope", "bend", "hinge", "saturation", "dead_zone", "threshold", "side", "table")
CURVES = ("shaft.knee_shaft_rpm", *(f"shaft.{form}_shaft_rpm" for form in FORMS))
# terms over the command that remember nothing
SAYS = {
    ZONE: ("shaft.dead_band", "shaft.dead_zone", *CURVES),
    CURVE: ("shaft.saturation", "shaft.dead_zone", *CURVES),
    GAIN: ("shaft.gain", "shaft.backwards", *CURVES),
    SIDES: ("shaft.back_gain", "shaft.back_zone"),
    SLOW: ("shaft.slow", "shaft.dead_time", "shaft.memory", "shaft.second_order"),
    BRAKE: ("x_load",),  # straight lines over it: any form
    SUPPLY: ("shaft.voltage_sag", "supply_v"),
    PLAY: ("gate.backlash", "gate.side", "gate.memory", "gate.slow"),
    # a value that a command of zero leaves
    LEVEL: ("shaft.neutral", "shaft.level", "x_t1", *CURVES),
    OTHER: ("x_other",),
    # A valve that stands while its command moves has its command's dead band and slip in one. A
    # dead zone, a coarse reading or a delay is another thing and a wrong name.
    STICKS: ("shaft.stiction", "gate.stiction"),
}
# Of the sweeps: r/min by r/min of the command is 1.32 from 30 to 60 % of the range, 1.20 up to
# 90 %, 1.08 above (robot 2, m1; 1.37, 1.23, 1.00 of robot 5): the curve bends. Settled speeds
# of the same command differ by direction: 27 against 0 and 218 against 162 r/min (stairs 2,
# left), 1071 against 1064 (sweep 2, m1), at every command alike. true of every encoder, and no
# fault: right along with anything
NEVER_BY_EYE = ("shaft.coarse_encoder",)


def _list_excused(case: Case) -> tuple[str, ...]:
    """Names that are no fault: a valve's flow has no encoder."""
    return () if case.file.startswith("valves/") else NEVER_BY_EYE


LEAST_ROWS = 60
# A file as near to the rival as this is as good.
NEAR = 1.15
VOLTS = ("10V", "14V", "16V", "20V")

# The slow machines (../shared/data/drives/slow), written before anything was run. Incubator, degC
# and s: heater 0 or 1; some 60 degC above the room at full, lag 600 s, dead time 20 to 50 s. By
# eye: 21 to 24 degC of the room below everything (LEVEL), the lag (SLOW), a gain off the sheet's.
# The room spans less than 1 degC: a line over it is no answer. Tanks, V and s: the level follows
# the pump through two tanks (lag 200 s), bends (the outflow goes with the root of the level) and
# ends at 10 V. Wheel of a ground vehicle, rad/s read as r/min by 60 / (2 pi): proportional to 6.8
# rad/s of 14.5 commanded, where it ends; the other side's command pulls along; no dead time worth
# a row.
INCUBATOR = {"full_rpm": 60.0, "tau_s": 600.0, "dead_s": 30.0, "noise_rpm": 0.1}
TANKS = {"full_rpm": 10.0, "tau_s": 200.0, "dead_s": 0.0, "noise_rpm": 0.02}
HUSKY = {"full_rpm": 140.0, "tau_s": 0.15, "dead_s": 0.05, "noise_rpm": 0.5}

# Valves of a refinery in closed loop (../shared/data/valves), written before anything was run.
# FIC46005, three recordings, sticks: the flow stands at 961 to 965 while the command climbs from
# 72.0 to 72.6 %, jumps up by some 8, stands at 973 to 975 while the command falls to 72.0, jumps
# down: S and J of some 0.6 % of the stroke alike, no backlash without a jump.
# FIC10112, two recordings, labelled as sticking: the flow reads 3.5e-44 in every row, whatever is
# commanded (1.23 to 1.33 %; 0.78 to 6.64 %). A reading that never moves tells a stuck valve from a
# shut one or a dead sensor by nothing: the honest answer is that the reading stands, no name.
# FIC10201 (3), FIC11502: the flow follows its command at once (R2 0.99): sound. FIC40102 C and E
# (2 each): R2 0.65 to 0.71 about a set point that moves, two to three times as steep as flow over
# stroke, no plateau: sound. PIC10201: a pressure that its loop holds, R2 0.69: sound.
# In none of the fourteen does the reading come in steps that an encoder could make.
STUCK_VALVES = ("2111FIC46005_0614_0003", "2111FIC46005_0902_0003", "2111FIC46005_1015_0003")
DEAD_READINGS = ("RHT-7050-342_FIC10112_0630_0002", "RHT-7050-342_FIC10112_0702_0009")
SOUND_VALVES = (
    "2111FIC10201_1018_0002",
    "2111FIC10201_1110_0002",
    "2111FIC10201_1212_0002",
    "2111FIC40102C_0905_0010",
    "2111FIC40102C_1110_0011",
    "2111FIC40102E_0824_0011",
    "2111FIC40102E_20250225_0009",
    "2111PIC10201_0903_0006",
    "RHT-7050-342_FIC11502_0628_0005",
)


class Case(NamedTuple):
    """One recording of one wheel. name : "kind/recording/wheel/direction"; what is paired has
    the kind and wheel of `pair`. file, columns : as the import file says them. rows : settled
    answers or not. sheet : the data sheet. truth : what is there by eye."""

    name: str
    pair: str
    file: str
    command: dict[str, Any]
    reading: dict[str, Any]
    sheet: dict[str, float]
    truth: tuple[str, ...]
    time: dict[str, Any]
    settled: bool
    # 1, -1: rows of one direction alone, turned forwards; 0: all
    side: int = 0
    names: tuple[str, ...] = ()
    extra: dict[str, Any] = {}  # further columns of the log
    stage: str = "shaft"
    # whether others of its pair are judged by what it gave
    fits: bool = True


def _wheels() -> list[Case]:
    """The two-wheeled robot: staircases of its command, and runs in closed loop."""
    found = []
    ms = {"column": "time", "counts": "ms"}
    for wheel in ("left", "right"):
        for run in (1, 2, 3):
            for word, side in (("forwards", 1), ("backwards", -1), ("both", 0)):
                if run > 1 or side == 1:
                    found.append(
                        Case(
                            f"stairs/{run}/{wheel}/{word}",
                            f"stairs/{wheel}/{word}",
                            f"wheelSpeedCalibration{run}.csv",
                            {"from": "motorCommand", "scale": 2.5},
                            {"from": f"{wheel}SpeedRpm"},
                            GEAR_MOTOR,
                            (ZONE, CURVE, GAIN, *(() if side else (SIDES,))),
                            ms,
                            True,
                            side,
                        )
                    )
        for run in (1, 2, 3):
            when = {"column": "time", "counts": "ms" if run == 1 else "s"}
            file = f"testPid{run}.csv"
            found.append(
                Case(
                    f"motor/{run}/{wheel}/forwards",
                    f"motor/{wheel}",
                    file,
                    {"from": f"{wheel}Command", "scale": 2.5},
                    {"from": f"{wheel}Speed"},
                    GEAR_MOTOR,
                    (ZONE, CURVE, GAIN, SLOW),
                    when,
                    False,
                )
            )
            found.append(
                Case(
                    f"loop/{run}/{wheel}/forwards",
                    f"loop/{wheel}",
                    file,
                    {"from": "targetSpeed"},
                    {"from": f"{wheel}Speed"},
                    GEAR_MOTOR,
                    (GAIN, SLOW),
                    when,
                    False,
                )
            )
    return found


def _football() -> list[Case]:
    """The football robots: duty cycle, a wheel in the air, sweeps."""
    found = []
    for run in (1, 2):
        found.append(
            Case(
                f"duty/{run}/motor/both",
                "duty",
                f"duty_run{run}.csv",
                {"from": "c1", "scale": 15.0},
                {"from": "c2", "unit": "rad/s"},
                FOOTBALL,
                (ZONE, GAIN, SLOW),
                {"counts": "rows", "step_s": 0.005},
                False,
                0,
                ("c1", "c2"),
            )
        )
    for wheel in (1, 2, 3, 4):
        found.append(
            Case(
                f"air/1/wheel {wheel}/both",
                "air",
                "wheel_air.csv",
                {"from": "c1", "unit": "rad/s"},
                {"from": f"c{1 + wheel}", "unit": "rad/s"},
                WHEEL_IN_AIR,
                (SLOW,),
                {"counts": "rows", "step_s": 0.005},
                False,
                0,
                ("c1", "c2", "c3", "c4", "c5"),
            )
        )
    for robot in (2, 3, 4, 5):
        for motor, sides in (
            ("m1", (0,)),
            ("m2", (0,)),
            ("m3", (0,)),
            ("m4", (0,)),
            ("mean", (1, -1)),
        ):
            for side in sides:
                word = {0: "both", 1: "forwards", -1: "backwards"}[side]
                found.append(
                    Case(
                        f"sweep/{robot}/{motor}/{word}",
                        f"sweep/{motor}/{word}",
                        f"sweep_robot{robot}.csv",
                        {"from": "pwm", "scale": 15.0},
                        {"from": motor, "unit": "rad/s"},
                        SWEPT,
                        (ZONE, CURVE, GAIN, *(() if side else (SIDES,))),
                        {"counts": "rows", "step_s": 1.0},
                        True,
                        side,
                    )
                )
    return found


def _known() -> list[Case]:
    """Recordings whose cause is known, a braked motor, a motor in open loop, a heater (tables
    by `_prepared`)."""
    found = []
    seconds = {"column": "time_s", "counts": "s"}
    for run in (1, 2):
        found.append(
            Case(
                f"braked/{run}/motor/forwards",
                "braked",
                f"braked_{run}.csv",
                {"from": "velocity setpoint [Hz]", "scale": 60.0},
                {"from": "velocity measured [Hz]", "scale": 60.0},
                BRAKED,
                (BRAKE, GAIN, SLOW),
                {"column": "time [s]", "counts": "s"},
                False,
                extra={"x_load": {"from": "load cell weight [g]"}},
            )
        )
    for run in (1, 2):
        found.append(
            Case(
                f"prbs/{run}/motor/forwards",
                "prbs",
                f"unA_prbs{run}.csv",
                {"from": "u", "scale": 30.0},
                {"from": "y", "scale": 1.0 / 6.0},
                DC_MOTOR,
                (ZONE, GAIN, SLOW),
                {"column": "t", "counts": "s"},
                False,
            )
        )
    for run in (1, 2):
        found.append(
            Case(
                f"heater/{run}/1/forwards",
                "heater",
                f"tclabA_{run}.txt",
                {"from": "u1", "scale": 0.7},
                {"from": "t1", "offset": -20.8},
                HEATER,
                (GAIN, SLOW),
                seconds,
                False,
                extra={"x_heater2": {"from": "u2"}},
            )
        )
    # halves of all supplies; and adopted at 14 V, judged at the others
    for which in ("even", "odd", *VOLTS):
        alone = which in VOLTS
        found.append(
            Case(
                f"thruster/{which}/motor/both",
                "thruster alone" if alone else "thruster",
                f"thruster/{which}",
                {"from": "pwm", "scale": 9.5, "offset": -14250.0},
                {"from": "rpm"},
                THRUSTER,
                ((ZONE, CURVE, GAIN, SIDES) if alone else (SUPPLY, ZONE, CURVE, GAIN, SIDES)),
                {"counts": "rows", "step_s": 1.0},
                True,
                extra={"supply_v": {"from": "v"}},
                fits=not alone or which == "14V",
            )
        )
    for word, truth in (("normal", (PLAY,)), ("lackLubrication1", (PLAY,)), ("backlash1", (PLAY,))):
        found.append(
            Case(
                f"actuator/{word}/gate/both",
                "actuator",
                f"actuator/{word}",
                {"from": "set_point"},
                {"from": "position"},
                ACTUATOR,
                truth,
                {"counts": "rows", "step_s": 0.04},
                False,
                extra={"x_current": {"from": "current"}, "x_load": {"from": "load"}},
                stage="gate",
            )
        )
    return found


def _slow() -> list[Case]:
    """Incubator, tanks, a vehicle's wheel (tables by `_prepared`)."""
    found = []
    for kind in ("exp", "rnd"):
        for run in (1, 2):
            found.append(
                Case(
                    f"incubator/{kind}{run}/t3/forwards",
                    f"incubator/{kind}",
                    f"slow/inc_{kind}{run}.csv.gz",
                    {"from": "heater_on", "scale": 60.0},
                    {"from": "t3"},
                    INCUBATOR,
                    (LEVEL, GAIN, SLOW),
                    {"column": "time", "counts": "unix_s"},
                    False,
                    extra={"x_t1": {"from": "t1"}},
                )
            )
    for word in ("Est", "Val"):
        found.append(
            Case(
                f"tanks/{word}/level/forwards",
                "tanks",
                f"slow/tanks.csv.gz/{word}",
                {"from": "u"},
                {"from": "y"},
                TANKS,
                (LEVEL, GAIN, SLOW, CURVE),
                {"counts": "rows", "step_s": 4.0},
                False,
            )
        )
    for word in ("A", "B"):
        found.append(
            Case(
                f"husky/{word}/left/both",
                "husky",
                f"slow/husky_{word}.csv.gz",
                {"from": "cmd_left", "unit": "rad/s"},
                {"from": "left_wheel_vel", "unit": "rad/s"},
                HUSKY,
                (CURVE, GAIN, SLOW, OTHER),
                {"column": "time", "counts": "s"},
                False,
                extra={"x_other": {"from": "cmd_right"}},
            )
        )
    return found


def _valves() -> list[Case]:
    """Control valves in closed loop: the machine file is the one that the log suggests."""
    found = []
    for folder, names, truth in (
        ("sticks", STUCK_VALVES, (STICKS, GAIN, LEVEL)),
        ("sticks", DEAD_READINGS, ()),
        ("sound", SOUND_VALVES, (GAIN, LEVEL, SLOW)),
    ):
        found += [
            Case(
                f"valve/{folder}/{name}",
                f"valve/{name.rsplit('_', 2)[0]}",
                f"valves/{folder}/{name}.txt.gz",
                {"from": "mv"},
                {"from": "pv"},
                {},
                truth,
                {"counts": "rows", "step_s": 10.0},
                False,
                fits=False,
            )
            for name in names
        ]
    return found


CASES = [*_wheels(), *_football(), *_known(), *_slow(), *_valves()]


def machine_text(case: Case, log: Path) -> str:
    """The machine file: what a data sheet says, and no more; without a data sheet what the log
    suggests."""
    s = case.sheet
    if not s:
        from topdress.console.cli.machine import DriveTarget, format_machine_file
        from topdress.control.calibration.first_machine import suggest_machine
        from topdress.drivers.files.any_log import open_any_log

        made = suggest_machine(dict(open_any_log(log).columns))
        made = made._replace(tau_s=made.tau_s or 0.05, both_ways=True)
        return format_machine_file(made, DriveTarget.PUMP, "suggested")
    if case.stage == "gate":
        return yaml.safe_dump(
            {
                "format": "topdress-machine/1",
                "id": "actuator",
                "gate": {"slew_mm_s": s["slew_mm_s"], "full_mm": 150.0, "dead_time_s": 0.0},
                "limits": {"opening_low_mm": 0.0, "opening_high_mm": 150.0},
                "noise": {"opening_mm": s["noise_mm"]},
            }
        )
    return yaml.safe_dump(
        {
            "format": "topdress-machine/1",
            "id": case.pair.split("/")[0],
            # no data sheet of a motor has a ramp, and `topdress machine --from` writes none
            "shaft": {
                "dead_time_s": s["dead_s"],
                "time_constant_s": s["tau_s"],
                "acceleration_rpm_s": 1e6,
                "nominal_supply_v": s.get("supply_v", 7.4),
                "full_rpm": s["full_rpm"],
            },
            "flow": {"full_rpm": s["full_rpm"]},
            "fall": {"full_rpm": s["full_rpm"]},
            "limits": {"shaft_low_rpm": 0.0, "shaft_high_rpm": s["full_rpm"]},
            "set_points": {"shaft_rpm": 0.5 * s["full_rpm"]},
            "noise": {"shaft_rpm": s["noise_rpm"]},
            "tolerance": {"shaft_percent": 0.5, "time_constant_s": 0.015},
        }
    )


COLUMNS_OF = {"shaft": ("shaft_rpm_cmd", "shaft_rpm"), "gate": ("opening_mm_cmd", "opening_mm")}


def import_text(case: Case) -> str:
    """The import file that a user writes."""
    command, reading = COLUMNS_OF[case.stage]
    said: dict[str, Any] = {
        "format": "topdress-import/1",
        "time": case.time,
        "columns": {command: case.command, reading: case.reading, **case.extra},
        "rows": "answer_in_row" if case.settled else "answer_next_row",
        "extra": "drop",
    }
    if case.names:
        said["source"] = {"names": list(case.names)}
    return yaml.safe_dump(said)


def _prepared(case: Case, folder: Path) -> Path | None:
    """A table with plain columns of a recording that is no such table; None of the others."""
    import csv
    import gzip

    kind, _, which = case.file.partition("/")
    if kind in ("slow", "valves"):
        return _prepared_archive(case, folder)
    rows: list[tuple[float | str, ...]] = []
    if case.pair == "braked":
        lines = [
            line
            for line in (DRIVES / case.file).read_text().splitlines()
            if not line.startswith("#")
        ]
        place = folder / f"{which or case.file}.table.csv"
        place.write_text("\n".join(lines) + "\n")
        return place
    if case.pair == "heater":
        rows.append(("time_s", "u1", "u2", "t1"))
        rows += [
            (t, u1, u2, t1)
            for t, u1, u2, t1, *_ in np.loadtxt(
                DRIVES / case.file, delimiter=",", skiprows=1
            ).tolist()
        ]
    # speeds have no sign: below 1500 us it turns backwards
    elif kind == "thruster":
        rows.append(("pwm", "rpm", "v"))
        for volts in (which,) if which in VOLTS else VOLTS:
            with (KNOWN / f"thruster_{volts}.csv").open(encoding="utf-8") as lines_of:
                for k, one in enumerate(list(csv.reader(lines_of))[1:]):
                    pwm, rpm, volt = float(one[0]), float(one[1]), float(one[3])
                    if which in VOLTS or k % 2 == (which == "odd"):
                        rows.append((pwm, rpm if pwm > 1500.0 else -rpm, volt))
    elif kind == "actuator":
        rows.append(("set_point", "position", "current", "load"))
        with gzip.open(KNOWN / f"actuator_{which}.csv.gz", "rt") as lines_of:
            rows += [
                (
                    float(one["set_point"]),
                    float(one["set_point"]) - float(one["position_error"]),
                    float(one["current"]),
                    float(one["load"]),
                )
                for one in csv.DictReader(lines_of)
            ]
    else:
        return None
    place = folder / f"{case.file.replace('/', '_')}.table.csv"
    place.write_text("".join(",".join(map(str, row)) + "\n" for row in rows))
    return place


def _prepared_archive(case: Case, folder: Path) -> Path:
    """A table with plain columns of a compressed recording: a tank's side, a valve's loop."""
    import csv
    import gzip

    place = folder / "table.csv"
    name, _, side = case.file.partition(".gz")
    parent = DRIVES if name.startswith("slow/") else SHARED / "data"
    lines = gzip.decompress((parent / f"{name}.gz").read_bytes()).decode().splitlines()
    if name.startswith("valves/"):
        cells = [line.split("\t") for line in lines[5:]]
        moved, read = np.array([[float(one[1]), float(one[2])] for one in cells]).T
        # As the import's guess scales a command without a unit.
        ratio = float(np.median(read / moved))
        ratio = ratio if ratio > 1e-30 else 1.0
        lines = ["mv,pv", *(f"{a * ratio},{b}" for a, b in zip(moved, read, strict=True))]
    elif side:
        last = side.lstrip("/")
        lines = ["u,y", *(f"{one['u' + last]},{one['y' + last]}" for one in csv.DictReader(lines))]
    place.write_text("\n".join(lines) + "\n")
    return place


def _one_side(case: Case, folder: Path) -> Path:
    """The rows of one direction as a file of their own, turned forwards."""
    source = _prepared(case, folder) or DRIVES / case.file
    if not case.side:
        return source
    lines = source.read_text().splitlines()
    heads = [name.strip() for name in lines[0].split(",")]
    command, reading = heads.index(case.command["from"]), heads.index(case.reading["from"])
    kept = [lines[0]]
    for line in lines[1:]:
        cells = line.split(",")
        if case.side * float(cells[command]) >= 0.0:
            for at in (command, reading):
                cells[at] = f"{case.side * float(cells[at]):g}"
            kept.append(",".join(cells))
    place = folder / source.name
    place.write_text("\n".join(kept) + "\n")
    return place


class Ran(NamedTuple):
    """A case that was run: files, what was said."""

    log: Path
    nominal: Path
    adopted: Path | None
    said: dict[str, Any]


def run(case: Case, folder: Path) -> Ran:
    """Import, diagnosis, adoption, by the functions behind the commands."""
    from topdress.console.reports.diagnosis_wording import is_undecided
    from topdress.control.diagnosis.extend import extend
    from topdress.control.diagnosis.runs.adoption import select_adoptable
    from topdress.control.diagnosis.runs.diagnose import diagnose_run
    from topdress.drivers.files.config import load_config, save_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND
    from topdress.drivers.files.imports.convert import convert_table
    from topdress.drivers.files.imports.log_file import write_imported_log
    from topdress.drivers.files.imports.log_join import join_files
    from topdress.drivers.files.imports.mapping import IMPORT_KIND
    from topdress.drivers.files.imports.table_reader import read_raw_table
    from topdress.drivers.files.read_log import read_nonempty_log

    place = folder / case.name.replace("/", "_").replace(" ", "_")
    place.mkdir()
    (place / "import.yaml").write_text(import_text(case))
    mapping = load_config(str(place / "import.yaml"), IMPORT_KIND).model
    log, adopted = place / "log.csv", place / "adopted.yaml"
    imported = join_files(
        [convert_table(read_raw_table(_one_side(case, place), mapping.source), mapping)],
        mapping.join,
    )
    write_imported_log(log, imported, mapping, place / "import.yaml")
    (place / "machine.yaml").write_text(machine_text(case, log))
    machine = load_config(str(place / "machine.yaml"), MACHINE_KIND).model
    started = time.process_time()
    try:
        found = diagnose_run(dict(read_nonempty_log(log).columns), machine, path=str(log))
    except ValueError as error:
        return Ran(
            log,
            place / "machine.yaml",
            None,
            {
                "verdict": "refused",
                "names": [],
                "p": [],
                "terms": [],
                "why": str(error),
                "cpu_s": 0.0,
            },
        )
    said = {
        "verdict": found.verdict,
        "names": [one.id for one in found.causes],
        "p": [round(one.probability, 3) for one in found.causes],
        "sizes": [one.size.value for one in found.causes],
        "open": [one.id for one in found.causes if one.rivals],
        "terms": [one.term["id"] for one in found.terms],
        "fitted": {}
        if found.fitted is None
        else {name: size.value for name, size in found.fitted.sizes},
        "left": [f"{one.channel}.{one.variable}" for one in found.unexplained],
        "cpu_s": round(time.process_time() - started, 1),
    }
    # as `diagnose --adopt` does
    taken = select_adoptable(found, [one.id for one in found.causes if not is_undecided(one)])
    there = bool(taken.found.causes or taken.found.terms or taken.found.fitted)
    said |= {
        "taken": [one.id for one in taken.found.causes],
        "refused": [name for name, _ in taken.refused],
    }
    if there:
        save_config(adopted, extend(machine, taken.found), MACHINE_KIND)
    return Ran(log, place / "machine.yaml", adopted if there else None, said)


def judged(case: Case, said: dict[str, Any]) -> str:
    """right, honest, wrong or false none, held against what is there by eye."""
    # A reading that never moves tells nothing, whatever the answer is but a name.
    if case.name.endswith(DEAD_READINGS):
        return "wrong" if said["names"] else "honest"
    if said["verdict"] == "none":
        return "false none" if case.truth else "right"
    claims = [*said["names"], *said["terms"]] if said["verdict"] == "named" else list(said["terms"])
    claims = [
        one
        for one in claims
        if one not in said.get("open", ()) and not one.startswith(_list_excused(case))
    ]
    if not claims:
        return "honest"
    known = [word for kind in case.truth for word in SAYS[kind]]
    return "right" if all(any(word in one for word in known) for one in claims) else "wrong"


def error_on(log: Path, machine_file: Path, case: Case) -> float:
    """r.m.s. of measured less predicted over every row of a log, r/min or mm, as a machine file
    stands."""
    from topdress.control.diagnosis.runs.channels import simulate_drive_rows
    from topdress.control.diagnosis.runs.drives import read_whole_drives
    from topdress.control.diagnosis.runs.hypothesis import list_stages, make_schedule
    from topdress.control.diagnosis.runs.log import clean_run_log
    from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND
    from topdress.drivers.files.read_log import read_nonempty_log

    machine = load_config(str(machine_file), MACHINE_KIND).model
    columns = {name: np.asarray(values) for name, values in read_nonempty_log(log).columns.items()}
    rows = len(columns["time_s"])
    # a short table of settled answers is predicted by being read again and again
    if rows < LEAST_ROWS:
        later = columns["time_s"][-1] + 1.0
        columns = {
            name: np.concatenate(
                [
                    values + k * later if name == "time_s" else values
                    for k in range(1 + LEAST_ROWS // rows)
                ]
            )
            for name, values in columns.items()
        }
    clean = clean_run_log(columns)
    drive = read_whole_drives(clean, machine)[case.stage]
    predicted = simulate_drive_rows(drive)(
        make_schedule(list_stages(machine), ()), MAX_MODEL_STEP_S
    )[:, 1]
    off = clean.columns[COLUMNS_OF[case.stage][1]] - predicted
    off = off[1:rows] if case.settled else off
    return float(np.sqrt(np.nanmean(np.square(off))))


def own_mean_on(log: Path, case: Case) -> float:
    """r.m.s. of a log's reading about its own mean, r/min or mm: what is known without a model."""
    from topdress.drivers.files.read_log import read_nonempty_log

    read = np.asarray(dict(read_nonempty_log(log).columns)[COLUMNS_OF[case.stage][1]], np.float64)
    return float(np.nanstd(read[1:] if case.settled else read))


def rival_on(fit: Path, held: Path, case: Case) -> tuple[float, str]:
    """The rival's error on the log that it was not fitted to, r/min or mm, and its form: along
    with it straight lines over the further columns, by least squares, cells far out held at the
    ends of the others."""
    import ast
    import importlib.util
    import warnings

    import pandas as pd

    command, reading = COLUMNS_OF[case.stage]
    tables = {path: pd.read_csv(path) for path in (fit, held)}
    for path, table in tables.items():
        table.rename(columns={command: "shaft_rpm_cmd", reading: "shaft_rpm"}).to_csv(
            path.with_suffix(".peer.csv"), index=False
        )
    fit_of, held_of = (path.with_suffix(".peer.csv") for path in (fit, held))
    tau_s = case.sheet.get("tau_s", 0.05)
    done = subprocess.run(
        [sys.executable, str(PEER), str(fit_of), str(held_of), "--tau", str(tau_s)],
        capture_output=True,
        text=True,
        check=True,
    )
    words = done.stdout.splitlines()[0].split("held", 1)[1]
    error, form = float(words.split()[0]), " ".join(words.split("{")[0].split()[1:])
    if not case.extra:
        return error, form
    spec = importlib.util.spec_from_file_location("peer", PEER)
    assert spec is not None and spec.loader is not None
    peer = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(peer)
    sizes = ast.literal_eval("{" + words.split("{")[1])
    names, ends, left, lines = list(case.extra), {}, {}, {}
    for path, of in ((fit, fit_of), (held, held_of)):
        time_s, u, y, settled = peer.load(of)
        said = peer.FORMS[form][1](sizes, u)
        said = (
            said
            if settled
            else peer.lagged(said, time_s, sizes.get("tau", tau_s), sizes.get("dead", 0.02), y[0])
        )
        series = [
            np.interp(time_s, tables[path]["time_s"], tables[path][name].ffill().bfill())
            for name in names
        ]
        if path == fit:
            ends = {
                name: np.percentile(one, (1.0, 99.0))
                for name, one in zip(names, series, strict=True)
            }
        held_in = [np.clip(one, *ends[name]) for name, one in zip(names, series, strict=True)]
        left[path], lines[path] = y - said, np.array([np.ones(len(y)), *held_in]).T
        if settled and "supply_v" in names:  # a supply acts in proportion
            lines[path] = np.hstack([lines[path], said[:, None] * lines[path]])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        slopes = np.linalg.lstsq(lines[fit], left[fit], rcond=None)[0]
    with_lines = float(np.sqrt(np.mean((left[held] - lines[held] @ slopes) ** 2)))
    return with_lines, f"{form}, lines over {', '.join(names)}"


def pairs(ran: dict[str, Ran]) -> list[tuple[Case, Case]]:
    """Each recording fitted to, and the others of its kind judged: where there are many, the
    next one."""
    found = []
    by_pair: dict[str, list[Case]] = {}
    for case in CASES:
        if case.name in ran:
            by_pair.setdefault(case.pair, []).append(case)
    for several in by_pair.values():
        for k, case in enumerate(several):
            others = (
                [one for one in several if one is not case]
                if len(several) < 4 or not all(one.fits for one in several)
                else [several[(k + 1) % len(several)]]
            )
            found += [(case, other) for other in others if case.fits]
    return found


def main() -> int:
    args = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    args.add_argument("--out", type=Path, default=None, help="figures as JSON")
    args.add_argument("--only", default="", help="cases whose name holds this")
    args.add_argument("--no-rival", action="store_true")
    args.add_argument("--no-pairs", action="store_true")
    args.add_argument("--against", type=Path, default=None, help="the --out of another run")
    given = args.parse_args()
    if not DRIVES.is_dir():
        print(f"{DRIVES}: not there: nothing to run")
        return 0
    before = json.loads(given.against.read_text()) if given.against else {"cases": {}, "pairs": {}}
    written: dict[str, Any] = {"cases": {}, "pairs": {}}
    with tempfile.TemporaryDirectory(prefix="drives-") as name:
        ran = _run_cases(given.only, Path(name), written, before)
        _kept(written, given.out)
        if not given.no_pairs:
            _run_pairs(ran, written, before, given.no_rival, given.out)
    return 0


def _kept(written: dict[str, Any], out: Path | None) -> None:
    """What is known so far: a run that is cut keeps it."""
    if out is not None:
        out.write_text(json.dumps(written, indent=1) + "\n")


def _run_cases(
    only: str, folder: Path, written: dict[str, Any], before: dict[str, Any]
) -> dict[str, Ran]:
    ran: dict[str, Ran] = {}
    for case in CASES:
        if only in case.name:
            ran[case.name] = one = run(case, folder)
            how = judged(case, one.said)
            written["cases"][case.name] = {
                **one.said,
                "judged": how,
                "adopted": one.adopted is not None,
            }
            found = ", ".join([*one.said["names"], *one.said["terms"]])
            was = before["cases"].get(case.name, {}).get("judged", "")
            print(
                f"{case.name:28s} {how:10s} {'file' if one.adopted else '    '} "
                f"{one.said['verdict']:12s} "
                f"{found or one.said.get('why', '-')[:60]}"
                f"{f'   (was {was})' if was not in ('', how) else ''}",
                flush=True,
            )
    _print_valves(written["cases"])
    counts = {
        word: sum(one["judged"] == word for one in written["cases"].values())
        for word in ("right", "honest", "wrong", "false none")
    }
    files = sum(one["adopted"] for one in written["cases"].values())
    print(
        f"\n{len(ran)} cases: "
        + ", ".join(f"{word} {count}" for word, count in counts.items())
        + f"; a file adopted {files}; processor "
        f"{sum(one['cpu_s'] for one in written['cases'].values()):.0f} s\n"
    )
    return ran


def _print_valves(cases: dict[str, Any]) -> None:
    """How often stiction, and steps of an encoder, are named in valves that stick and do not."""
    for word in ("sticks", "sound"):
        names = [
            dict(zip(one["names"], one["p"], strict=True)) if one["verdict"] != "refused" else {}
            for name, one in cases.items()
            if name.startswith(f"valve/{word}")
        ]
        if names:
            sticks, steps = (
                sum(one.get(f"shaft.{effect}", 0.0) >= 0.9 for one in names)
                for effect in ("stiction", "coarse_encoder")
            )
            print(f"{len(names)} valves, {word}: stiction named {sticks}, coarse encoder {steps}")


def _run_pairs(
    ran: dict[str, Ran],
    written: dict[str, Any],
    before: dict[str, Any],
    no_rival: bool,
    out: Path | None,
) -> None:
    print(
        f"{'fitted to -> judged on':52s} {'nominal':>8s} {'adopted':>8s} {'rival':>8s} {'mean':>8s}"
    )
    for case, other in pairs(ran):
        key = f"{case.name} -> {other.name}"
        one, held = ran[case.name], ran[other.name]
        nominal = error_on(held.log, one.nominal, other)
        adopted = None if one.adopted is None else error_on(held.log, one.adopted, other)
        known = before["pairs"].get(key, {})
        rival, form = known.get("rival"), known.get("form", "")
        if rival is None and not no_rival:
            rival, form = rival_on(one.log, held.log, case)
        written["pairs"][key] = {
            "nominal": nominal,
            "adopted": adopted,
            "rival": rival,
            "mean": own_mean_on(held.log, other),
            "form": form,
        }
        _kept(written, out)
        print(
            f"{key:52s} {nominal:8.1f} {'-' if adopted is None else f'{adopted:.1f}':>8s} "
            f"{'-' if rival is None else f'{rival:.1f}':>8s} {written['pairs'][key]['mean']:8.1f}  "
            f"{form}",
            flush=True,
        )
    done = list(written["pairs"].values())
    with_rival = [one for one in done if one["rival"] is not None]
    # No file is needed where the data sheet is as near.
    near = sum(
        (one["nominal"] if one["adopted"] is None else one["adopted"]) <= NEAR * one["rival"]
        for one in with_rival
    )
    adopted = [one for one in done if one["adopted"] is not None]
    print(
        f"\n{len(done)} pairs: within {NEAR:g} of the rival, or no file needed, {near} of "
        f"{len(with_rival)}; adopted {len(adopted)}; adopted and above nominal "
        f"{sum(one['adopted'] > one['nominal'] for one in adopted)}; above the reading's own mean "
        f"{sum(one['adopted'] > one['mean'] for one in adopted)}"
    )


if __name__ == "__main__":
    sys.exit(main())

"""How fast `topdress simulate` is, and whether its rows stay: `python -m benchmarks simulate_speed --against TREE`

Speed: a run of `--seconds`, the whole process, in turns with the other tree; simulated seconds for each second of the
processor, which a busy machine stretches less than the clock. Rows: ten set-ups, run log and truth of each by sha256
against the other tree's. Linux or macOS.
"""
from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from trees import environment_of, ratio, spread, trees
from verdict import exit_code

EFFECTS = ("flow.gain=8", "gate.backlash=1@60", "shaft.dead_time=0.1", "speed.gnss_latency=0.4", "flow.pulsation=5",
           "shaft.coarse_encoder=1", "flow.bridging=5")
SET_UPS: dict[str, tuple[str, ...]] = {
    "demo": ("--seconds", "400", "--seed", "7"),
    "speed first": ("--seconds", "200", "--seed", "2", "--strategy", "speed_first"),
    "balanced, carried along": ("--seconds", "200", "--seed", "3", "--strategy", "balanced",
                                "--plant", "carried_along"),
    "no look-ahead, no trim": ("--seconds", "200", "--seed", "4", "--look-ahead", "off", "--flow-trim", "off"),
    "seven effects": ("--seconds", "300", "--seed", "5", *(word for one in EFFECTS for word in ("--effect", one))),
    "a term": ("--seconds", "200", "--seed", "6", "--term", "flow_percent bend speed_mps bend=-4.4 at=1.2"),
    "map": ("--job", "map_demo", "--seconds", "300", "--seed", "7"),
    "points": ("--job", "points_demo", "--machine", "planter", "--seconds", "100", "--seed", "8"),
    "sections": ("--job", "sections_demo", "--machine", "huanghai_sections", "--seconds", "300", "--seed", "9"),
    "spreader, falling singly": ("--job", "spreader_demo", "--machine", "spreader", "--seconds", "400", "--seed", "10",
                                 "--plant", "singly"),
}


def simulated(tree: Path, out: Path, *options: str) -> float:
    """Processor's seconds of the whole process. Raises CalledProcessError."""
    before = os.times()
    program = Path(sys.executable).parent / "topdress"
    subprocess.run([str(program), "simulate", "--force", "--out", str(out), *options], env=environment_of(tree),
                   check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def sums(tree: Path, folder: Path, options: tuple[str, ...]) -> tuple[str, str]:
    """sha256 of run log and truth."""
    out = folder / "run.csv"
    simulated(tree, out, *options)
    log, truth = (hashlib.sha256(one.read_bytes()).hexdigest() for one in (out, out.with_name("run.truth.csv")))
    return log, truth


def run() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="another tree, measured in the same run")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--no-rows", action="store_true", help="leave the ten set-ups out")
    given = parser.parse_args()
    both = trees(given.against)
    speeds: dict[str, list[float]] = {name: [] for name in both}
    promises: dict[str, object] = {}
    print(f"load average at the start: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for tree in both.values():
            simulated(tree, folder / "run.csv", "--seconds", "1")           # modules compiled, caches filled
        for _time in range(given.times):
            for name, tree in both.items():
                speeds[name].append(given.seconds / simulated(tree, folder / "run.csv", "--seconds", f"{given.seconds}",
                                                              "--seed", "7"))
        for name in both:
            print(f"{name}: {spread(speeds[name], 0)}, simulated seconds a second of the processor, whole process")
        print(ratio("seconds of the processor", {
            name: [given.seconds / speed for speed in found] for name, found in speeds.items()}))
        for what, options in {} if given.no_rows or len(both) < 2 else SET_UPS.items():
            found = {name: sums(tree, folder, options) for name, tree in both.items()}
            promises[f"{what}: the same rows"] = found["old"] == found["new"]
            print(f"{what:26} {'same' if found['old'] == found['new'] else 'DIFFERENT'} {found['new'][0][:16]} "
                  f"{found['new'][1][:16]}", flush=True)
    return exit_code(promises | {"it was simulated": all(speeds.values())})


if __name__ == "__main__":
    sys.exit(run())

"""Ground covered twice while files were taken in between: `python -m benchmarks ground_done`

A field on the simulated machine, on an injected clock: 15 m, then a map is taken on the Job page, and so on with
another job, machine, crop and a boundary that was driven. After every one the driver goes over the same ground again,
from the beginning of the pass, and 15 m farther. What lies where is counted under the plant's own outlets, in
cells of 0.2 m.
`--against TREE`: the same by the code of another one.
"""
from __future__ import annotations

import argparse
import asyncio
import json
import subprocess
import sys
import tempfile
from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from trees import environment_of, trees, worked

CELL_M, WIDTH_M = 0.2, 2.4
PART_M = 15.0               # of new ground in every part
PASS_M = 100.0
SPEED_MPS = 1.25
DRIVES_OFF_S = 8.0          # ready, start, and the drives' dead time
DONE_KG_HA = 20.0           # a cell that got less was passed by
TAKEN = ("map", "job", "machine", "crop", "boundary")


class Part(NamedTuple):
    what: str
    twice_m2: float         # that got material in an earlier part, and again in this one
    twice_kg: float
    ground_kg: float        # of all parts up to this one
    shown_kg: float         # the job's total, as the console has it


class GroundKg:
    """Material by cell, of one part: what leaves the outlets lands a drop time later, under them."""

    def __init__(self, width_m: float) -> None:
        self.kg: dict[tuple[int, int], float] = {}
        self._aside = np.arange(-0.5 * width_m + 0.5 * CELL_M, 0.5 * width_m, CELL_M)
        self._falling: deque[tuple[float, float]] = deque()
        self._time_s = 0.0

    def take(self, truth: Any) -> None:
        self._falling.append((truth.time_s + truth.drop_s, truth.flow_kg_s * (truth.time_s - self._time_s)))
        self._time_s = truth.time_s
        while self._falling and self._falling[0][0] <= truth.time_s:
            kg = self._falling.popleft()[1] / len(self._aside)
            turn = np.radians(truth.heading_deg)
            for aside in self._aside if kg > 0.0 else ():
                cell = (int((truth.east_m + aside * np.cos(turn)) // CELL_M),
                        int((truth.north_m - aside * np.sin(turn)) // CELL_M))
                self.kg[cell] = self.kg.get(cell, 0.0) + kg


def covered(arguments: list[str], until_s: float) -> tuple[GroundKg, float]:
    """What one worker covers from its start until it is asked to end, and its total, kg."""
    now_s = 0.0

    def wait(seconds: float) -> None:
        nonlocal now_s
        now_s += seconds

    ground = GroundKg(WIDTH_M)
    host = worked(arguments, lambda: now_s, wait, until_s, keep=lambda plant, truth: ground.take(truth))
    return ground, host.newest.applied_kg


def of_this_tree(folder: Path) -> list[Part]:
    """With the code that this process was started with."""
    import console.services.launcher as launchers
    from console.app.pages.job.service import MapReading
    from console.services.job import JobFiles
    from console.worker import resume_assemble
    from control.geodesy import TangentPlane
    from drivers.files.config import load, save, shipped
    from drivers.files.kinds import JOB
    started: list[list[str]] = []
    launchers.start_worker = lambda arguments, trouble: started.append(list(arguments))   # type: ignore[assignment]
    resume_assemble._driven_m = lambda *_: 0.0          # the driver goes over the same ground again
    demo = load(shipped("jobs")["demo"], JOB).model
    own = folder / "mine.yaml"
    demo = demo.model_copy(update={"simulated": demo.simulated.model_copy(update={
        "pass_length_m": PASS_M, "run_in_m": 2.0, "speed_kmh": 3.6 * SPEED_MPS, "speed_wander_percent": 0.0})})
    save(own, demo, JOB, "")
    save(folder / "other.yaml", demo.model_copy(update={"id": "other", "title": "Another job"}), JOB, "")
    launcher = launchers.Launcher((str(own),), (), 1, 20.0, str(folder / "logs" / "run.csv"), folder / "trouble")
    desk = JobFiles(launcher, folder)
    plane = TangentPlane(demo.field.origin_lat_deg, demo.field.origin_lon_deg)
    ring = tuple(plane.to_deg(*corner) for corner in ((-3.0, -1.0), (60.0, -1.0), (60.0, 101.0), (-3.0, 101.0)))

    def take(what: str) -> None:
        if what == "map":
            desk.take_map(desk.preview(str(shipped("jobs")["map_demo"].with_suffix(".geojson")), MapReading()))
        elif what == "boundary":
            desk.take_boundary(ring)
        elif what == "job":
            desk.take("job", str(folder / "other.yaml"))
        else:
            desk.take(what, str(shipped(f"{what}s")[{"machine": "huanghai", "crop": "osu_winter_wheat_2002"}[what]]))

    parts: list[Part] = []
    before: dict[tuple[int, int], float] = {}
    launcher.start()
    for number, what in enumerate(("", *TAKEN), start=1):
        if what:
            take(what)
            try:
                asyncio.run(desk.restart())
            except AttributeError:          # no worker of its own to be linked to
                pass
        ground, shown_kg = covered(started[-1], DRIVES_OFF_S + (2.0 + number * PART_M) / SPEED_MPS)
        least_kg = DONE_KG_HA * CELL_M ** 2 / 10_000.0
        twice = [kg for cell, kg in ground.kg.items() if kg >= least_kg and before.get(cell, 0.0) >= least_kg]
        for cell, kg in ground.kg.items():
            before[cell] = before.get(cell, 0.0) + kg
        parts.append(Part(what or "first", len(twice) * CELL_M ** 2, sum(twice), sum(before.values()), shown_kg))
    return parts


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--against", type=Path, metavar="TREE", help="the same with the code of another tree")
    options.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.one:
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps(of_this_tree(Path(folder))))
        return 0
    for name, tree in trees(given.against).items():
        out = subprocess.run([sys.executable, __file__, "--one"], env=environment_of(tree), check=True,
                             capture_output=True, text=True).stdout
        parts = [Part(*one) for one in json.loads(out.splitlines()[-1])]
        print(f"| {name}: taken | covered twice, m2 | kg there again | kg on the ground | kg as shown |")
        print("|---|---|---|---|---|")
        for part in parts:
            print("|", " | ".join([part.what, f"{part.twice_m2:.1f}", *(f"{kg:.2f}" for kg in part[2:])]), "|")
        twice_m2, twice_kg = sum(part.twice_m2 for part in parts), sum(part.twice_kg for part in parts)
        print(f"| all | {twice_m2:.1f} | {twice_kg:.2f} | | |\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

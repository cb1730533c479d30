"""The control worker killed at random over TCP, and gone on with: `python benchmarks/kills.py --kills N`

The virtual machine (this process) drives on a field behind its TCP ports; the real worker works on it, is killed
(SIGKILL) after 2 to 9 s, and a new one goes on with the job. What really left the outlets, and where it fell, is known
here. Told of every cut: the time that is not in the log, how long material fell after it, the kilograms released that
the job's totals do not know when it goes on, and the length of ground that has its material and would get it again
(negative: that has none and would get none).

With `--state FILE` it is resumable: cuts are kept there, and a further call goes on until N are done. The exit code is
1 where a log is damaged, or the job could not be gone on with, or no material flowed, or more was lost or given twice
than is promised.
"""
from __future__ import annotations

import argparse
import asyncio
import bisect
import contextlib
import datetime as dt
import json
import os
import random
import signal
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from verdict import exit_code

from console.link import Link, WorkerGone
from console.running import start_worker
from console.worker import resume
from console.worker.resume_tail import with_tail
from control.orders import Do, Order
from control.simulation.assembly import simulated_machine, with_simulated_field
from control.simulation.plant import Truth
from drivers.devices.board_frames import SILENT_HOST_S
from drivers.files.read_log import read_log
from drivers.files.setup import load_setup
from drivers.virtual.served import Serve, ServedMachine

PLANT_STEP_S = 0.02
KILLS_A_PART = 20               # cuts of one job on one machine
SHORTEST_S, LONGEST_S = 2.0, 9.0
ENDS_WITHIN_S = 5.0             # after a kill
STOPPED = 0.02                  # of the flow before: less is none
LEAST_GOING_ON, MOST_LOST_S, MOST_SECOND_M = 0.95, 2.5, 1.0      # a job cut off in its first seconds is none yet
WORKS_WITHIN_S = 40.0           # after a start: a turn at the field's end takes its time


class Field:
    """The virtual machine in a thread of its own, and what really happened."""

    def __init__(self, seed: int) -> None:
        self.setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
        job = self.setup.job
        sim = job.simulated.model_copy(update={"pass_length_m": 400.0})
        self.job = with_simulated_field(job.model_copy(update={"simulated": sim}), self.setup.machine)
        self.truth: list[tuple[float, Truth]] = []              # when (time.monotonic), what
        plant = simulated_machine(self.setup.machine, self.job, seed, PLANT_STEP_S, keep=self._keep)
        self.machine = ServedMachine(plant, Serve(host="127.0.0.1", first_port=0, heads=6,
                                                  opening_mm=self.setup.machine.set_points.opening_mm), time.monotonic)
        self.began_s = time.monotonic()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._drive, daemon=True)
        self._thread.start()

    def _keep(self, truth: Truth) -> None:
        self.truth.append((truth.time_s, truth))

    def _drive(self) -> None:
        while not self._end.wait(PLANT_STEP_S / 2.0):
            self.machine.advance()

    def close(self) -> None:
        self._end.set()
        self._thread.join(2.0)
        self.machine.close()

    @property
    def now_s(self) -> float:
        """On the plant's clock."""
        return time.monotonic() - self.began_s

    def released_kg(self) -> float:
        return sum(one.flow_kg_s for _, one in self.truth) * PLANT_STEP_S

    def cab(self, folder: Path) -> Path:
        urls = {one.device: one.url for one in self.machine.addresses}
        path = folder / "cab.yaml"
        path.write_text(yaml.safe_dump({
            "format": "topdress-cab/1", "virtual": True, "gnss": {"port": urls["gnss"]},
            "heads": {"ports": [urls[f"head_{n}"] for n in range(1, 7)]}, "board": {"port": urls["board"]}}))
        return path


async def part(seed: int, kills: int, folder: Path) -> list[dict[str, Any]]:
    """A job of so many cuts."""
    chance = random.Random(seed)
    field = Field(seed)
    await asyncio.sleep(1.0)
    cuts: list[dict[str, Any]] = []
    before: Path | None = None
    counted_kg = 0.0
    try:
        for number in range(kills):
            log = folder / f"{seed}-{number}.csv"
            going_on = [] if before is None else ["--resume", str(resume.beside(before))]
            where = await asyncio.to_thread(
                start_worker, ["--config", str(field.cab(folder)), "--log", str(log), *going_on],
                folder / "trouble", run_file=folder / "w.json")
            link = Link(where)
            running = asyncio.create_task(link.run())
            await asyncio.wait_for(link.attached.wait(), 10)
            assert link.newest is not None
            resumed_kg = link.newest.applied_kg
            if cuts and cuts[-1]["resumable"]:
                cuts[-1]["resumed_off_kg"] = resumed_kg - cuts[-1]["known_kg"]
            worked = await _work(link, chance.uniform(SHORTEST_S, LONGEST_S))
            skew_s = time.monotonic() - field.began_s - (link.newest.at_s + _age_s(link))
            os.kill(where.pid, signal.SIGKILL)
            killed_s = field.now_s
            running.cancel()
            with contextlib.suppress(WorkerGone, asyncio.CancelledError, TimeoutError):
                await running
            await asyncio.sleep(ENDS_WITHIN_S)
            cut = judged(field, log, killed_s, skew_s) | {"seed": seed, "number": number, "worked": worked,
                                                           "resumed_kg": resumed_kg}
            if cut["resumable"]:
                before = log
                cut["uncounted_kg"] = (field.released_kg() - cut["known_kg"]) - counted_kg
                counted_kg += cut["uncounted_kg"]
            cuts.append(cut)
    finally:
        field.close()
    return cuts


def _age_s(link: Link) -> float:
    return 0.0 if link.newest_at_s is None else time.monotonic() - link.newest_at_s


async def _work(link: Link, seconds: float) -> bool:
    """Start work, and go on for so long."""
    until_s, worked_until_s = time.monotonic() + WORKS_WITHIN_S, None
    while time.monotonic() < (worked_until_s or until_s):
        frame = link.newest
        assert frame is not None
        if frame.row.state == "working" and (frame.row.shaft_rpm or 0.0) > 5.0 and worked_until_s is None:
            worked_until_s = time.monotonic() + seconds
        if frame.row.state != "working" and (frame.row.speed_used_mps or 0.0) > 0.5:
            with contextlib.suppress(TimeoutError):
                await link.order(Order(Do.ACKNOWLEDGE, ""))
                await link.order(Order(Do.READY))
                await link.order(Order(Do.START))
        await asyncio.sleep(0.05)
    return worked_until_s is not None


def judged(field: Field, log: Path, killed_s: float, skew_s: float) -> dict[str, Any]:
    """One cut against what really happened. Times on the plant's clock; `skew_s`: of the log's times on it."""
    cut: dict[str, Any] = {"damaged": "", "resumable": False}
    try:
        rows = list(read_log(log).rows())
        cut["lost_s"] = killed_s - (rows[-1].time_s + skew_s)
    except (OSError, ValueError, IndexError) as error:
        return cut | {"damaged": f"{type(error).__name__}: {error}"}
    near = [(at_s, one) for at_s, one in field.truth if at_s > killed_s - 10.0]
    least_kg_s = STOPPED * max(one.flow_kg_s for _, one in near)
    released = [(at_s, one) for at_s, one in near if one.flow_kg_s > least_kg_s]
    landed_s = max((at_s + one.drop_s for at_s, one in released), default=None)
    flowed = landed_s is not None and landed_s > killed_s
    cut["released_s"] = released[-1][0] - killed_s if flowed else None
    cut |= {"flow_end_s": landed_s - killed_s if landed_s is not None and flowed else None, "known_kg": 0.0}
    try:
        kept = with_tail(resume.read(resume.beside(log)), field.setup.machine, field.setup.crop.product_n_fraction,
                         SILENT_HOST_S)
    except (OSError, ValueError) as error:
        return cut | {"why_not": f"{type(error).__name__}: {error}"}
    cut |= {"resumable": kept.worth_going_on, "known_kg": kept.sums.kg, "area_ha": kept.area_ha,
            "last_row_s": rows[-1].time_s}
    if landed_s is not None and flowed and kept.origin_deg is not None:
        cut["second_m"] = second_dose_m(field, kept, landed_s)
    return cut


def second_dose_m(field: Field, kept: resume.Snapshot, landed_s: float) -> float:
    """Along the way: up to where material lies, less up to where the job knows of it. Negative: ground left out."""
    times = [at_s for at_s, _ in field.truth]
    def at(time_s: float) -> Truth:
        return field.truth[min(len(times) - 1, bisect.bisect_left(times, time_s))][1]

    def known(one: Truth) -> bool:
        row = int((one.north_m - kept.ground.south_m) // kept.ground.cell_m)
        column = int((one.east_m - kept.ground.west_m) // kept.ground.cell_m)
        rows, columns = kept.ground.done.shape
        return 0 <= row < rows and 0 <= column < columns and bool(kept.ground.done[row, column])

    way = [one for at_s, one in field.truth if at_s > landed_s - 8.0]
    # beyond where the machine is by now the job may believe more than is there: looked for straight ahead
    ends = [one.driven_m for one in way if known(one)]
    return at(landed_s).driven_m - max(ends, default=at(landed_s - 8.0).driven_m)


def percentiles(values: list[float]) -> str:
    if not values:
        return "-"
    ordered = sorted(values)
    return f"median {statistics.median(ordered):.3f}, 95 % {ordered[int(0.95 * (len(ordered) - 1))]:.3f}, " \
           f"least {ordered[0]:.3f}, most {ordered[-1]:.3f} (n {len(ordered)})"


def told(cuts: list[dict[str, Any]]) -> Iterator[str]:
    def of(name: str) -> list[float]:
        return [cut[name] for cut in cuts if cut.get(name) is not None]

    yield f"kills: {len(cuts)}, at work {sum(cut['worked'] for cut in cuts)}"
    yield f"logs damaged: {sum(bool(cut['damaged']) for cut in cuts)}"
    yield f"resumable: {sum(cut['resumable'] for cut in cuts)}"
    yield f"not in the log, s: {percentiles(of('lost_s'))}"
    yield f"outlets give material after the kill, s: {percentiles(of('released_s'))}"
    yield f"material falls after the kill, s: {percentiles(of('flow_end_s'))}"
    yield f"released and not in the totals, kg a cut: {percentiles(of('uncounted_kg'))}"
    yield f"ground that would get a second dose (negative: none), m: {percentiles(of('second_m'))}"
    yield f"the same by its size, m: {percentiles([abs(value) for value in of('second_m')])}"


def promised(cuts: list[dict[str, Any]]) -> dict[str, object]:
    """Of all cuts."""
    worked = [cut for cut in cuts if cut["worked"]]
    second_m = [cut["second_m"] for cut in cuts if cut.get("second_m") is not None]
    lost_s = [cut["lost_s"] for cut in cuts if cut.get("lost_s") is not None]
    return {
        "material flowed before at least one kill": worked,
        "no log is damaged": not any(cut["damaged"] for cut in cuts),
        f"{sum(cut['resumable'] for cut in worked)} of {len(worked)} can go on: at least {LEAST_GOING_ON:.0%}":
            sum(cut["resumable"] for cut in worked) >= LEAST_GOING_ON * len(worked),
        f"at most {MOST_LOST_S:g} s of rows lost": lost_s and max(lost_s) <= MOST_LOST_S,
        f"second dose at most {MOST_SECOND_M:g} m at the median": second_m and statistics.median(
            second_m) <= MOST_SECOND_M}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--state", type=Path)
    given = parser.parse_args()
    cuts: list[dict[str, Any]] = []
    if given.state is not None and given.state.exists():
        cuts = json.loads(given.state.read_text(encoding="utf-8"))
    while len(cuts) < given.kills:
        with tempfile.TemporaryDirectory() as folder:
            seed = given.seed * 1000 + len(cuts)
            cuts += asyncio.run(part(seed, min(KILLS_A_PART, given.kills - len(cuts)), Path(folder)))
        if given.state is not None:
            given.state.write_text(json.dumps(cuts), encoding="utf-8")
        print(f"{len(cuts)} of {given.kills}", file=sys.stderr, flush=True)
    print("\n".join(told(cuts)))
    sys.exit(exit_code(promised(cuts)))


if __name__ == "__main__":
    main()

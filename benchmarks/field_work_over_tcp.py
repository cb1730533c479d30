"""Field work in real time over TCP, every device unplugged and plugged in again once.

`topdress serve-machine` in one process, the control worker in another, an operator (this program) on its link. Tells
what the operator saw and when, how soon each loss was reacted to, and whether anything is missing from the log.

    python -m benchmarks field_work_over_tcp --seconds 600
"""
from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import yaml

from console.frame import Frame
from console.link import Link, WorkerGone
from console.running import start_worker
from control.orders import Do, Order
from drivers.files.read_log import read_log

LONGEST_HOLE_S = 2.0            # in the log's times: a worker that hung, not one that was late
SERVE = [sys.executable, "-c", "from console.cli import main; main()", "serve-machine", "--port", "0", "--seed", "3"]


def time_line(seconds: float, rounds: int) -> list[tuple[str, float, float]]:
    """(device, from_s, for_s), spread over the run; all heads at once at the end of each round."""
    devices = [("gnss", 8.0), *((f"head_{n}", 4.0) for n in range(1, 7)), ("board", 3.0), ("heads", 5.0)] * rounds
    apart_s = (seconds - 60.0) / len(devices)
    return [(device, 40.0 + place * apart_s, lasts_s) for place, (device, lasts_s) in enumerate(devices)]


def serve(faults: list[tuple[str, float, float]]) -> tuple[subprocess.Popen[str], dict[str, str], float]:
    options = [word for device, begin_s, lasts_s in faults
               for word in ("--fault", f"unplug:{device}@{begin_s:g}+{lasts_s:g}")]
    child = subprocess.Popen([*SERVE, *options], stdout=subprocess.PIPE, text=True)
    urls: dict[str, str] = {}
    assert child.stdout is not None
    for line in child.stdout:
        if line.startswith("serving"):
            break
        device, _, url = line.split()
        urls[device] = url
    return child, urls, time.monotonic()


def cab_file(folder: Path, urls: dict[str, str]) -> Path:
    path = folder / "cab.yaml"
    path.write_text(yaml.safe_dump({
        "format": "topdress-cab/1", "virtual": True, "gnss": {"port": urls["gnss"]},
        "heads": {"ports": [urls[f"head_{n}"] for n in range(1, 7)]}, "board": {"port": urls["board"]}}))
    return path


class Operator:
    """Starts work, notes what the frames say, and goes on after a fault as soon as the board is back."""

    def __init__(self, link: Link, began_s: float) -> None:
        self.seen: list[tuple[float, str]] = []
        self._link = link
        self._began_s = began_s
        self._before: set[str] = set()

    async def work(self, until_s: float) -> None:
        while time.monotonic() - self._began_s < until_s:
            frame = self._link.newest
            if frame is not None:
                self._look(frame)
                await self._act(frame)
            await asyncio.sleep(0.02)

    def _look(self, frame: Frame) -> None:
        said = {f"alarm {alarm.id}" for alarm in frame.alarms} | {f"state {frame.row.state}"}
        said |= {f"head {head} dropped" for head in frame.dropped_heads}
        said |= {f"{device.name} not connected" for device in frame.devices if not device.connected}
        at_s = time.monotonic() - self._began_s
        self.seen += [(at_s, f"+ {what}") for what in sorted(said - self._before)]
        self.seen += [(at_s, f"- {what}") for what in sorted(self._before - said) if not what.startswith("state")]
        self._before = said

    async def _act(self, frame: Frame) -> None:
        state = frame.row.state
        moving = (frame.row.speed_used_mps or 0.0) > 0.5 and frame.row.shaft_rpm is not None
        if state == "working" or not moving:
            return
        with contextlib.suppress(TimeoutError):
            for alarm in frame.alarms:
                if not alarm.acknowledged:
                    await self._link.order(Order(Do.ACKNOWLEDGE, alarm.id))
            if state != "ready":
                await self._link.order(Order(Do.READY))
            await self._link.order(Order(Do.START))


async def watched(pid: int, rss: list[tuple[float, float]]) -> None:
    """Memory of the worker, MB, every ten seconds. Linux only."""
    status = Path(f"/proc/{pid}/status")
    while status.exists():
        with contextlib.suppress(OSError, StopIteration):
            line = next(line for line in status.read_text().splitlines() if line.startswith("VmRSS"))
            rss.append((time.monotonic(), int(line.split()[1]) / 1024))
        await asyncio.sleep(10.0)


def judge(seen: list[tuple[float, str]], faults: list[tuple[str, float, float]]) -> list[str]:
    """For each loss: the first word of it, the reaction, and when it was as before."""
    wanted = {"gnss": "+ alarm gnss_silent", "board": "+ state fault", "heads": "+ alarm ndvi_silent"}
    lines = []
    for device, begin_s, lasts_s in faults:
        reaction = wanted.get(device) or f"+ head {device[-1]} dropped"
        name = "head_1" if device == "heads" else device

        def after(what: str, from_s: float) -> str:
            return next((f"{at_s - from_s:.2f}" for at_s, said in seen if said == what and at_s > from_s - 0.05), "-")
        lines.append(f"| {device} | {begin_s:.0f} | {lasts_s:.0f} | {after(f'+ {name} not connected', begin_s)} | "
                     f"{reaction[2:]} | {after(reaction, begin_s)} | "
                     f"{after(f'- {name} not connected', begin_s + lasts_s)} | "
                     f"{after('+ state working', begin_s) if device == 'board' else 'worked on'} |")
    return lines


async def run(seconds: float, rounds: int, folder: Path) -> list[str]:
    """What was promised and not kept."""
    faults = time_line(seconds, rounds)
    machine, urls, began_s = serve(faults)
    log = folder / "run.csv"
    rss: list[tuple[float, float]] = []
    try:
        where = await asyncio.to_thread(
            start_worker, ["--config", str(cab_file(folder, urls)), "--log", str(log)], folder / "trouble",
            run_file=folder / "w.json")
        link = Link(where)
        running = asyncio.create_task(link.run())
        await asyncio.wait_for(link.attached.wait(), 10)
        operator = Operator(link, began_s)
        memory = asyncio.create_task(watched(where.pid, rss))
        await operator.work(seconds)
        memory.cancel()
        stats = await link.stats(2.0)
        totals = link.newest
        await link.stop_worker()
        running.cancel()
        with contextlib.suppress(WorkerGone, asyncio.CancelledError):
            await running
    finally:
        machine.terminate()
        machine.wait(10)
    for at_s, what in operator.seen:
        print(f"{at_s:8.2f} s  {what}")
    print("\n| device | unplugged at s | for s | seen as gone after s | reaction | after s | back after plugging in, s "
          "| working again after s |\n|---|---|---|---|---|---|---|---|")
    print("\n".join(judge(operator.seen, faults)))
    rows = list(read_log(log).rows())
    steps = [after.time_s - before.time_s for before, after in itertools.pairwise(rows)]
    assert totals is not None
    print(f"\nlog: {len(rows)} rows over {rows[-1].time_s:.1f} s, longest step {max(steps):.3f} s, "
          f"{sum(step > 0.075 for step in steps)} steps above 0.075 s; last state {rows[-1].state}")
    print(f"worked {totals.area_ha:.3f} ha, {totals.applied_kg:.1f} kg")
    print("loop:", ", ".join(f"{name} {value:g}" for name, value in sorted(stats.items())))
    if len(rss) > 10:
        later = rss[len(rss) // 3:]                 # what the start takes is no slope
        slope = statistics.linear_regression([at_s for at_s, _mb in later], [mb for _at_s, mb in later]).slope
        print(f"memory: {later[0][1]:.1f} MB to {later[-1][1]:.1f} MB, slope {3600.0 * slope:.2f} MB an hour, most "
              f"{max(mb for _at_s, mb in rss):.1f} MB")
    alarms = Counter(what for _at_s, what in operator.seen if what.startswith("+ alarm"))
    print("alarms:", dict(alarms))
    trouble = (folder / "trouble").read_text().strip()
    print("trouble:", trouble or "none")
    return [
        *(["nothing was applied"] if not totals.applied_kg > 0.0 else []),
        *([f"the log ends at {rows[-1].time_s:.0f} s of {seconds:.0f}"] if rows[-1].time_s < 0.95 * seconds else []),
        *([f"a hole of {max(steps):.2f} s in the log"] if max(steps) > LONGEST_HOLE_S else []),
        *([f"the worker wrote trouble: {trouble.splitlines()[-1]}"] if trouble else []),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rounds", type=int, default=1, help="how often every device is unplugged")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        broken = asyncio.run(run(given.seconds, given.rounds, Path(place)))
    for line in broken:
        print("not kept:", line, file=sys.stderr)
    sys.exit(bool(broken))

"""What a wrong GNSS place costs the control loop: `python benchmarks/position_jumps.py`

The machine works in manual mode at 20 Hz, GNSS at 10 Hz. After 20 s GNSS tells places so far to the north-east: one
epoch, or all from then on. Every case runs in a process of its own with at most 3 GB of memory. Printed: the slowest
tick from the jump on (of the thread's own time), the memory that the process took more, the ground that counts as done
more than without a jump, how many ticks of the ten seconds after the jump had flow, and what was told.
"""
from __future__ import annotations

import argparse
import datetime as dt
import gc
import json
import subprocess
import sys
import time
from typing import Any

from verdict import exit_code

JUMPS_KM = (0.0, 1.0, 2.0, 50.0, 5000.0)
HOWS = ("one epoch", "stays there")
WORKED_S, AFTER_S = 20.0, 10.0
MEMORY_BYTES = 3 * 1024 ** 3
SLOWEST_MS, MORE_MB, MORE_M2 = 50.0, 20.0, 5.0        # a tick is 50 ms; a working width by 2 m of way
DEGREES_KM = 0.707 / 111.0, 0.707 / 91.9         # of latitude and longitude, a km to the north-east at 34.28 N


def case(jump_km: float, how: str) -> dict[str, Any]:
    from control.field.job import Wanted
    from control.orders import Do, Order, TargetSource
    from control.readings import DriveCommand
    from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
    from control.simulation.measuring import Measuring
    from drivers.files.setup import load_setup

    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    target = Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0)
    job = with_simulated_field(setup.job.model_copy(update={"target": target}), setup.machine)
    plant = simulated_machine(setup.machine, job, 1, 0.05)
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    measuring, sensed = Measuring(6), plant.step(DriveCommand(0.0, 25.0), False)
    loop.order(Order(Do.READY))
    before_mb, slowest_ms, flowing, told, jumped = 0.0, 0.0, 0, set(), None
    for k in range(round((WORKED_S + AFTER_S) / 0.05)):
        m = measuring.take(sensed)
        after = m.time_s >= WORKED_S
        if after and before_mb == 0.0:
            before_mb = _peak_mb()
            _limit_memory()
            gc.disable()                        # a collection of the start's rubbish is not the tick's work
        if after and m.gnss is not None and (how == "stays there" or jumped in (None, m.gnss.time_s)):
            jumped = m.gnss.time_s
            north_deg, east_deg = (jump_km * degrees for degrees in DEGREES_KM)
            m = m._replace(gnss=m.gnss._replace(lat_deg=m.gnss.lat_deg + north_deg, lon_deg=m.gnss.lon_deg + east_deg))
        began = time.thread_time()
        try:
            tick = loop.tick(m)
        except MemoryError:
            return {"ended": f"MemoryError after {time.thread_time() - began:.1f} s of a tick"}
        if after:
            slowest_ms = max(slowest_ms, 1e3 * (time.thread_time() - began))
            flowing += not tick.why_no_flow
            told |= {alarm.id for alarm in tick.alarms}
            told |= {word.split()[0] for word in (tick.row.events or "").split(";") if word}
        if k == 80:
            loop.order(Order(Do.START))
        sensed = plant.step(tick.command, tick.enabled)
    return {"slowest_ms": slowest_ms, "more_mb": _peak_mb() - before_mb, "covered_m2": 1e4 * loop.totals.covered_ha,
            "flowing": flowing, "told": ", ".join(sorted(told)) or "-"}


def _peak_mb() -> float:
    import resource
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _limit_memory() -> None:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


def promised(who: str, found: dict[str, Any], none_m2: float, none: bool) -> dict[str, object]:
    """`none`: no jump; `none_m2`: the ground that is done then."""
    if "ended" in found:
        return {f"{who}: ended: {found['ended']}": False}
    more_m2 = found["covered_m2"] - none_m2
    said = {f"{who}: slowest tick {found['slowest_ms']:.1f} ms: at most {SLOWEST_MS:g}":
            found["slowest_ms"] <= SLOWEST_MS,
            f"{who}: {found['more_mb']:.0f} MB more: at most {MORE_MB:g}": found["more_mb"] <= MORE_MB}
    if none:
        return said | {f"{who}: {found['covered_m2']:.1f} m2 done: above 0": found["covered_m2"] > 0.0,
                       f"{who}: {found['flowing']} ticks with flow: all but a few": found["flowing"] > 190}
    return said | {f"{who}: {more_m2:.1f} m2 counted as done: at most {MORE_M2:g}": more_m2 <= MORE_M2,
                   f"{who}: told": found["told"] != "-"}


def main() -> int:
    given = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    given.add_argument("--case", nargs=2, metavar=("KM", "HOW"), help=argparse.SUPPRESS)
    asked = given.parse_args()
    if asked.case:
        print(json.dumps(case(float(asked.case[0]), asked.case[1])))
        return 0
    print("| jump km | how | slowest tick ms | more memory MB | more ground m2 | ticks with flow of 201 | told |")
    print("|---|---|---|---|---|---|---|")
    none_m2, promises = 0.0, dict[str, object]()
    for how in HOWS:
        for km in JUMPS_KM:
            done = subprocess.run([sys.executable, __file__, "--case", str(km), how], capture_output=True, text=True)
            found = json.loads(done.stdout) if done.returncode == 0 else {"ended": done.stderr.strip()[-60:]}
            promises |= promised(f"{km:g} km, {how}", found, none_m2, km == 0.0)
            if "ended" in found:
                print(f"| {km:g} | {how} | {found['ended']} | | | | |", flush=True)
                continue
            none_m2 = found["covered_m2"] if km == 0.0 else none_m2
            print(f"| {km:g} | {how} | {found['slowest_ms']:.2f} | {found['more_mb']:.0f} | "
                  f"{found['covered_m2'] - none_m2:.1f} | {found['flowing']} | {found['told']} |", flush=True)
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())

"""The live check: false alarms in healthy work, and how long an effect works before the line
says so.

Logs are those of the hidden generator of tests/diagnosis, which shares no formula with the
program: machines within their tolerances, four kinds of noise, all programmes. They are fed
half a minute at a time, as they would grow.

    python -m benchmarks live_check [--hours 50] [--delays] [--seed 1]

Exit code 1 where there is more than one false alarm in 100 hours.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "diagnosis"))
sys.path.insert(0, str(Path(__file__).parents[1]))

from hidden import noise as run_noise
from hidden import runlog
from hidden.courses import ONSET, Course
from hidden.nominal import Effect
from hidden.plant import Plant
from hidden.programmes import Programme, chosen, drive
from hidden.run_cases import LEAST_KG, within_tolerance
from topdress.control.diagnosis.live.growing_log_check import CHECK_INTERVAL_S, LiveCheck
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

Columns = dict[str, npt.NDArray[Any]]
PROMISED = 1.0  # false alarms in 100 hours, at most
# three and six quarters of an hour: two in a row may say something
MINUTES, REFILLED_MINUTES = 46.0, 91.0
BEGINS_S = 900.0
SIZES: dict[str, tuple[float, float, float]] = {  # in the catalogue's units
    "flow.gain": (-2.0, -4.0, -8.0),
    "flow.fill_falloff": (6.0, 12.0, 20.0),
    "shaft.gain": (-1.0, -2.0, -5.0),
    "gate.offset": (0.5, 1.0, 2.0),
    "speed.wheel_radius": (2.0, 4.0, 8.0),
    "canopy.head_fouled": (-5.0, -10.0, -20.0),
}


def log_of(
    seed: int, effects: tuple[Effect, ...] = (), programme: Programme | None = None
) -> Columns | None:
    """None where the hopper would have run empty."""
    rng = np.random.default_rng([seed, 19])
    programmes = chosen("all")
    p = programme or programmes[int(rng.integers(len(programmes)))]
    minutes = REFILLED_MINUTES if p.refill else MINUTES
    d = drive(p._replace(minutes=(minutes, minutes)), int(rng.integers(1 << 30)))
    noises = run_noise.noises(str(rng.choice(run_noise.KINDS)), d.row_s, rng)
    physics = within_tolerance(rng, bool(d.refill_kg))
    columns = runlog.columns(Plant(d), physics, effects, noises, int(rng.integers(1 << 30)))
    return None if np.nanmin(columns["hopper_kg"]) < LEAST_KG else columns


def lines(columns: Columns) -> Iterator[tuple[float, str, str]]:
    """(time, channel, cause) whenever the line on the Run page would change to say something."""
    check, time_s = LiveCheck(load_config("huanghai", MACHINE_KIND).model), columns["time_s"]
    last = None
    for at_s in np.arange(
        time_s[0] + CHECK_INTERVAL_S, time_s[-1] + CHECK_INTERVAL_S, CHECK_INTERVAL_S
    ):
        new = (time_s > at_s - CHECK_INTERVAL_S) & (time_s <= at_s)
        check.add_rows({name: array[new] for name, array in columns.items()})
        if check.is_due:
            standing = check.check_rows()
            said = None if standing is None else (standing.channel, standing.cause)
            if said is not None and said != last:
                yield (check.now_s, *said)
            last = said


def healthy(hours: float, seed: int) -> bool:
    worked_h, number, found, used_s = 0.0, seed, [], 0.0
    while worked_h < hours:
        columns, begin = log_of(number), time.process_time()
        if columns is not None:
            # one alarm a log: the first line stands until it is looked at
            found += list(lines(columns))[:1]
            worked_h += float(np.ptp(columns["time_s"])) / 3600.0
            used_s += time.process_time() - begin
        number += 1
    low, high = (
        (0.5 * chi2.ppf(0.05, 2 * len(found)) if found else 0.0),
        0.5 * chi2.ppf(0.95, 2 * len(found) + 2),
    )
    rate = 100.0 * len(found) / worked_h
    print(
        f"healthy: {worked_h:.1f} h, {len(found)} false alarms: {rate:.2f} in 100 h, 90 % interval "
        f"{100 * low / worked_h:.2f} to {100 * high / worked_h:.2f} (promised: at most "
        f"{PROMISED:g})"
    )
    print(f"processor: {100.0 * used_s / (3600.0 * worked_h):.1f} % of one core")
    for line in found:
        print("  false:", *line)
    return rate <= PROMISED


def delays(seed: int, repeated: int) -> None:
    print("effect, size, started at 900 s: minutes to the line (name), or not said")
    fits = [p for p in chosen("all") if p.strategy != "opening_first"]
    for which in (1, 2, 0):  # the middle sizes first: a run may be cut
        for k, (effect, sizes) in enumerate(SIZES.items()):
            size, cells = sizes[which], []
            for again in range(repeated):
                number = seed + 1000 * again + k
                e = Effect(
                    effect,
                    size,
                    0,
                    0.5,
                    None,
                    2 if effect.startswith("canopy") else None,
                    number,
                    course=Course(ONSET, BEGINS_S, 0.0),
                )
                columns = log_of(number, (e,), fits[(2 * k + again) % len(fits)])
                if columns is None:
                    cells.append("no log")
                    continue
                cells.append(
                    next(
                        (
                            f"{(at_s - BEGINS_S) / 60.0:.1f} ({cause or channel})"
                            for at_s, channel, cause in lines(columns)
                        ),
                        "not said",
                    )
                )
            print(f"  {effect:20} {size:6g}  {'   '.join(cells)}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--hours", type=float, default=50.0)
    parser.add_argument("--delays", action="store_true")
    parser.add_argument("--repeated", type=int, default=2, help="logs for each effect and size")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.delays:
        delays(given.seed, given.repeated)
    return 0 if given.hours <= 0.0 or healthy(given.hours, given.seed) else 1


if __name__ == "__main__":
    sys.exit(main())

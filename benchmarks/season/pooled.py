"""A season of 1,000 logs against its table of truth: `python -m benchmarks season/pooled
[--seeds 11 12]`

Each log's forms are drawn about what was planted (`truth.py`), with the information of eight
logs that the hidden generator of tests/diagnosis made row by row and that were really
diagnosed. Exit code 1 where a promise is not kept.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks"), str(ROOT / "tests" / "diagnosis")]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402
from hidden import noise as run_noise  # noqa: E402
from hidden import runlog  # noqa: E402
from hidden.plant import Plant  # noqa: E402
from hidden.programmes import chosen, drive  # noqa: E402
from hidden.run_cases import within_tolerance  # noqa: E402
from judged import judge  # noqa: E402
from topdress.control.diagnosis.season.effect_timelines import fit_season  # noqa: E402
from topdress.control.diagnosis.season.log_evidence import (  # noqa: E402
    QuadraticForm,
    SeasonLog,
    collect_log_evidence,
)
from topdress.control.machine.machine import Machine  # noqa: E402
from topdress.drivers.files.config import load_config  # noqa: E402
from topdress.drivers.files.config_kinds import MACHINE_KIND  # noqa: E402
from truth import MACHINES, WEAK, WEAK_PROGRAMME, Day, days  # noqa: E402
from verdict import exit_code  # noqa: E402

REAL = 8  # logs whose information is drawn from
PROGRAMMES = [one for one in chosen("all") if one.strategy != "opening_first" and not one.refill]
ROW_HZ = 10.0


def columns_of(day: Day, minutes: float) -> dict[str, Any]:
    """What a healthy machine logged on a day; it keeps its tolerances and its sensors' noise
    over the season."""
    rng = np.random.default_rng([1, 191, day.number, day.day])
    wanted = (
        WEAK_PROGRAMME
        if day.machine == WEAK
        else PROGRAMMES[int(rng.integers(len(PROGRAMMES)))].name
    )
    programme = next(one for one in PROGRAMMES if one.name == wanted)
    done = drive(
        programme._replace(minutes=(minutes, minutes), row_hz=ROW_HZ), int(rng.integers(1 << 30))
    )
    own = np.random.default_rng([1, 195, day.number])
    noises = run_noise.noises(
        "ar1" if day.machine == WEAK else str(own.choice(run_noise.KINDS)), done.row_s, own
    )
    physics = within_tolerance(np.random.default_rng([1, 192, day.number]), False)
    return runlog.columns(Plant(done), physics, (), noises, 1000 * day.number + day.day)


def root_of(normal: np.ndarray) -> np.ndarray:
    """A square root of a covariance that may be singular: some effects are one."""
    values, vectors = np.linalg.eigh(normal)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def drawn(
    form: QuadraticForm, truth: dict[str, float], off: dict[str, float], rng: np.random.Generator
) -> QuadraticForm:
    """A log's form where the sizes are `truth`, and the machine is off by `off` of its
    tolerances."""
    normal, pulls = np.array(form.normal), np.array(form.pulls)
    size = np.array([truth.get(name, 0.0) for name in form.names])
    shift = pulls @ np.array([off.setdefault(name, float(rng.normal())) for name in form.open])
    noise = root_of(normal - pulls @ pulls.T) @ rng.normal(size=len(size))
    return form._replace(right=tuple((normal @ size + shift + noise).tolist()))


def season_of(
    seed: int, real: list[tuple[QuadraticForm, ...]], weak: tuple[QuadraticForm, ...]
) -> list[SeasonLog]:
    """Every day of every machine; `weak`: of the machine whose effect is seen in no single log."""
    rng, logs = np.random.default_rng([seed, 17]), list[SeasonLog]()
    off: dict[str, dict[str, float]] = {}
    for day in days():
        forms = weak if day.machine == WEAK else real[int(rng.integers(REAL))]
        truth: dict[str, float] = {}
        for name, size, member in day.effects:
            key = name if member is None else f"{name}#{member}"
            truth[key] = truth.get(key, 0.0) + size
        logs.append(
            SeasonLog(
                f"{day.machine}-{day.day}",
                day.machine,
                float(day.day),
                tuple(drawn(form, truth, off.setdefault(day.machine, {}), rng) for form in forms),
                {"product": day.product, "operator": day.operator, "field": day.field},
            )
        )
    return logs


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(11, 21)))
    parser.add_argument(
        "--minutes", type=float, default=6.0, help="of each of the logs that were really diagnosed"
    )
    given = parser.parse_args()
    machine: Machine = load_config("huanghai", MACHINE_KIND).model
    real = [
        collect_log_evidence(
            columns_of(Day("m00", 0, day, "urea", "Zhao", "", ()), given.minutes), machine
        ).forms
        for day in range(REAL)
    ]
    weak = collect_log_evidence(
        columns_of(Day(WEAK, 15, 0, "urea", "Zhao", "", ()), given.minutes), machine
    ).forms
    promises: dict[str, object] = {}
    for seed in given.seeds:
        logs = season_of(seed, real, weak)
        begin = time.process_time()
        fit = fit_season(logs)
        print(
            f"seed {seed}: {len(logs)} logs of {MACHINES} machines put together in "
            f"{time.process_time() - begin:.1f} s of processor",
            flush=True,
        )
        for said, kept in judge(fit.courses, fit.shared).items():
            print(("  kept      " if kept else "  NOT KEPT  ") + said, flush=True)
            promises[f"seed {seed}: {said}"] = kept
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())

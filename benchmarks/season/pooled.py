"""A season without its logs: each log's forms drawn about the truth, with the information of real logs."""
from __future__ import annotations

import time

import numpy as np
from season.judged import Checks, Reported, judge
from season.logs import columns_of
from season.truth import MACHINES, NEVER_REFILLS, Day, days

from control.diagnosis.season.courses import fitted
from control.diagnosis.season.evidence import Form, evidence
from control.diagnosis.season.forms import OneLog
from control.machine.machine import Machine

REAL = 8                    # logs whose information is drawn from


def root_of(normal: np.ndarray) -> np.ndarray:
    """A square root of a covariance that may be singular: some effects are one."""
    values, vectors = np.linalg.eigh(normal)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def drawn(form: Form, truth: dict[str, float], off: dict[str, float], rng: np.random.Generator) -> Form:
    """A log's form where the sizes are `truth`, and the machine is off by `off` of its tolerances."""
    normal, pulls = np.array(form.normal), np.array(form.pulls)
    size = np.array([truth.get(name, 0.0) for name in form.names])
    shift = pulls @ np.array([off.setdefault(name, float(rng.normal())) for name in form.open])
    noise = root_of(normal - pulls @ pulls.T) @ rng.normal(size=len(size))
    return form._replace(right=tuple((normal @ size + shift + noise).tolist()))


def pooled(seeds: list[int], minutes: float, machine: Machine) -> Checks:
    """The whole table of truth, for each seed."""
    real = [evidence(columns_of(Day("m00", 0, day, "urea", "Zhao", "", ()), minutes, 1), machine).forms
            for day in range(REAL)]
    weak = evidence(columns_of(Day("m15", 15, 0, "urea", "Zhao", "", ()), minutes, 1), machine).forms
    every = Checks()
    for seed in seeds:
        rng, logs = np.random.default_rng([seed, 17]), list[OneLog]()
        off: dict[str, dict[str, float]] = {}
        for day in days():
            forms = weak if day.machine == "m15" else real[int(rng.integers(REAL))]
            truth: dict[str, float] = {}
            for name, size, member in day.effects:
                key = name if member is None else f"{name}#{member}"
                truth[key] = truth.get(key, 0.0) + size
            logs.append(OneLog(f"{day.machine}-{day.day}", day.machine, float(day.day), tuple(
                drawn(form, truth, off.setdefault(day.machine, {}), rng) for form in forms),
                {"product": day.product, "operator": day.operator, "field": day.field}))
        begin = time.process_time()
        fit = fitted(logs)
        print(f"seed {seed}: {len(logs)} logs of {MACHINES} machines put together in "
              f"{time.process_time() - begin:.1f} s of processor; {NEVER_REFILLS} is of whole logs only", flush=True)
        judge(Reported(fit.courses, fit.shared, None, 0.0), every)
    return every

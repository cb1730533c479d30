"""An effect of z 3 in each log, over 30 logs that no other machine stands beside; and the same logs without it."""
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from hidden import noise as run_noise
from hidden import runlog
from hidden.detect import Eye
from hidden.nominal import Effect, Physics
from hidden.plant import Plant
from hidden.programmes import drive
from hidden.run_cases import within_tolerance
from season.judged import Checks
from season.logs import PROGRAMMES, ROW_HZ

from console.services.fleet_job import record
from console.services.fleet_season import one_log
from control.diagnosis.season.courses import fitted
from control.machine.machine import Machine
from drivers.files.log_store import write_store
from drivers.files.run_meta import run_meta

# No nominal value of the machine file is this effect: what a value may be off within its tolerance is the same in all
# logs of a machine, so that one within three tolerances is told by no number of them, but by its change alone.
EFFECT, PER_CENT, LOGS, PROGRAMME = "flow.slope", 0.14, 30, "grid_long"


def weak(minutes: float, machine: Machine, seed: int, checks: Checks) -> None:
    """Each log diagnosed; then what all of them say together."""
    programme = next(one for one in PROGRAMMES if one.name == PROGRAMME)
    physics = within_tolerance(np.random.default_rng([seed, 71]), False)
    for size in (PER_CENT, 0.0):
        records, z = [], []
        with tempfile.TemporaryDirectory() as folder:
            for number in range(LOGS):
                done = drive(programme._replace(minutes=(minutes, minutes), row_hz=ROW_HZ), 1000 * seed + number)
                noises = run_noise.noises("ar1", done.row_s, np.random.default_rng([seed, 72]))
                planted = (Effect(EFFECT, size, 0),) if size else ()
                columns = runlog.columns(Plant(done), physics, planted, noises, 1000 * seed + number)
                place = Path(folder) / f"{number:02d}.parquet"
                write_store(place, columns, run_meta(machine, started_utc=f"2026-03-{number + 1:02d}T08:00:00Z",
                                                     extra={"unit": "m"}))
                records.append({"key": place.stem, **record(str(place), {}, machine.model_dump(mode="json"), {})})
                z += [Eye(Plant(done), noises, Physics()).z(planted)] if planted else []
        found = {one.effect: one.probability for one in fitted([one_log(one) for one in records]).courses}
        named = sum(EFFECT in [cause["id"] for cause in one["causes"]] for one in records)
        if size:
            checks.that(list(found) == [EFFECT], f"{EFFECT} {size:g}, z {min(z):.1f} to {max(z):.1f} (mean "
                        f"{np.mean(z):.1f}) in each of {LOGS} logs: told over all {found}; single logs named it "
                        f"{named} times")
        else:
            checks.that(not found, f"the same {LOGS} logs without it: told over all {found}")

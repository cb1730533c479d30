"""Logs of a season, made row by row by the hidden generator of tests/diagnosis, and files that are none."""
from __future__ import annotations

import datetime as dt
import io
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from hidden import noise as run_noise
from hidden import nominal, runlog
from hidden.nominal import Effect
from hidden.plant import Plant
from hidden.programmes import Drive, chosen, drive
from hidden.run_cases import within_tolerance
from season.truth import FIRST_DAY, WEAK, WEAK_PROGRAMME, WRONG_CLOCK, Day

from control.machine.machine import Machine
from drivers.files.log_store import read_store, write_store, write_text
from drivers.files.run_meta import run_meta

PROGRAMMES = [one for one in chosen("all") if one.strategy != "opening_first" and not one.refill]
ROW_HZ = 10.0
LEFT_KG = 3.0               # in the hopper of an operator who never refills, at the end of a log


def driven(day: Day, minutes: float, seed: int = 0) -> tuple[Drive, dict[str, run_noise.Noise]]:
    """What was driven on a day, and the noise of the machine's own sensors; the same each time."""
    rng = np.random.default_rng([seed, 191, day.number, day.day])
    wanted = WEAK_PROGRAMME if day.machine == WEAK else PROGRAMMES[int(rng.integers(len(PROGRAMMES)))].name
    programme = next(one for one in PROGRAMMES if one.name == wanted)
    done = drive(programme._replace(minutes=(minutes, minutes), row_hz=ROW_HZ), int(rng.integers(1 << 30)))
    if not day.refilled:
        per_row = nominal.FLOW_G_PER_REV_MM / 60_000.0 * done.row_s
        done = done._replace(start_kg=LEFT_KG + 1.1 * per_row * float(done.shaft_rpm_cmd @ done.opening_mm_cmd))
    own = np.random.default_rng([seed, 195, day.number])
    kind = "ar1" if day.machine == WEAK else str(own.choice(run_noise.KINDS))
    return done, run_noise.noises(kind, done.row_s, own)


def effects_of(day: Day) -> tuple[Effect, ...]:
    return tuple(Effect(name, size, 0, member=member) for name, size, member in day.effects)


def columns_of(day: Day, minutes: float, seed: int = 0) -> dict[str, Any]:
    """A machine keeps its own tolerances over the season."""
    done, noises = driven(day, minutes, seed)
    physics = within_tolerance(np.random.default_rng([seed, 192, day.number]), False)
    return runlog.columns(Plant(done), physics, effects_of(day), noises, 1000 * day.number + day.day)


def make(folder: Path, days: Iterable[Day], minutes: float, machine: Machine, seed: int = 0) -> None:
    """Those that are missing. Even days as text with a sidecar, odd days as Parquet."""
    for day in days:
        path = folder / day.machine / f"{day.day:02d}.{'parquet' if day.day % 2 else 'csv'}"
        if path.exists():
            continue
        began = dt.datetime.fromisoformat(f"{FIRST_DAY}T08:00:00+00:00") + dt.timedelta(days=day.day)
        meta = run_meta(machine, started_utc=WRONG_CLOCK.get((day.machine, day.day), began.isoformat()), extra={
            "unit": day.unit, "product": day.product, "operator": day.operator, "field": day.field})
        store = path.with_suffix(".parquet")
        write_store(store, columns_of(day, minutes, seed), meta)
        if path != store:
            stored = read_store(store)
            write_text(path, stored.columns, stored.meta)
            store.unlink()


def make_broken(folder: Path) -> list[Path]:
    """A header alone, a Parquet file cut short, a zip of another name, rows of another program, nothing at all."""
    place = folder / "broken"
    place.mkdir(parents=True, exist_ok=True)
    zipped = io.BytesIO()
    with zipfile.ZipFile(zipped, "w") as archive:
        archive.writestr("a.txt", "nothing of a log")
    stored = io.BytesIO()
    import polars as pl
    pl.DataFrame({"time_s": np.arange(1000.0)}).write_parquet(stored)
    files = {"header.csv": b"time_s,shaft_rpm\n", "cut.parquet": stored.getvalue()[:-100],
             "zip.csv": zipped.getvalue(), "other.csv": "Kunde;Betrag\nMüller;12,50\nMaier;7,00\n".encode("latin-1"),
             "empty.csv": b""}
    for name, data in files.items():
        (place / name).write_bytes(data)
    return [place / name for name in files]


def long_log(path: Path, rows: int, machine: Machine, seed: int = 0) -> None:
    """One log of at least so many rows: runs of 20 minutes at 20 Hz one after another, the hopper filled between."""
    if path.exists():
        return
    parts: list[dict[str, Any]] = []
    count, begin_s = 0, 0.0
    while count < rows:
        rng = np.random.default_rng([seed, 193, len(parts)])
        programme = PROGRAMMES[len(parts) % len(PROGRAMMES)]._replace(minutes=(20.0, 20.0), row_hz=20.0)
        done = drive(programme, int(rng.integers(1 << 30)))
        noises = run_noise.noises("ar1", done.row_s, np.random.default_rng([seed, 194]))
        physics = within_tolerance(np.random.default_rng([seed, 192, 99]), False)
        part = runlog.columns(Plant(done), physics, (), noises, len(parts))
        if parts:
            filled = part["hopper_kg"][0] - parts[-1]["hopper_kg"][-1]
            part["events"][0] = f"refill {filled:.1f}"
        part["time_s"] = np.round(part["time_s"] + begin_s, 3)
        begin_s, count = float(part["time_s"][-1]) + 0.05, count + len(part["time_s"])
        parts.append(part)
    columns = {name: np.concatenate([part[name] for part in parts])[:rows] for name in parts[0]}
    write_store(path, columns, run_meta(machine, started_utc=f"{FIRST_DAY}T08:00:00Z", extra={
        "unit": "long", "product": "urea", "operator": "Zhao", "field": "long"}))

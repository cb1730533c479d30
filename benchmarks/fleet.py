"""A fleet against the truth: what was planted, what a season of logs says; a worker killed; one worker against two.

    python benchmarks/fleet.py pooled                       1,000 logs of 20 machines, each log as its quadratic form
    python benchmarks/fleet.py logs DIR [--minutes 8]       makes logs with planted courses in DIR (hidden generator)
    python benchmarks/fleet.py run DIR [--kill]             `topdress fleet` on them; truth against told

Exit code 1 where a promise is not kept. `pooled` draws each log's form about the truth with the information of a real
log, so that a thousand logs cost seconds; `run` diagnoses every log.
"""
from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from control.diagnosis.season.courses import Course, OneLog, courses
from control.diagnosis.season.evidence import Form, evidence
from control.diagnosis.season.owner import repaired_d, wears
from drivers.files.config import load
from drivers.files.kinds import MACHINE
from drivers.files.log_store import write_store
from drivers.files.run_meta import run_meta
from tests.diagnosis.hidden import noise as run_noise
from tests.diagnosis.hidden import runlog
from tests.diagnosis.hidden.nominal import Effect
from tests.diagnosis.hidden.plant import Plant
from tests.diagnosis.hidden.programmes import chosen, drive
from tests.diagnosis.hidden.run_cases import within_tolerance

ROOT = Path(__file__).parents[1]
MACHINES, LOGS = 20, 50
WEAR, REPAIR, WEAK, PRODUCT = ("m03", "m07"), "m11", "m15", "compound"
WEAK_Z, WEAK_LOGS = 3.0, 30
Failed = list[str]


def check(failed: Failed, kept: bool, said: str) -> None:
    print(("  kept    " if kept else "  NOT KEPT ") + said)
    if not kept:
        failed.append(said)


def drawn_log(minutes: float, effects: tuple[Effect, ...], seed: int) -> dict[str, Any]:
    rng = np.random.default_rng([seed, 191])
    programmes = [p for p in chosen("all") if p.strategy != "opening_first" and not p.refill]
    d = drive(programmes[seed % len(programmes)]._replace(minutes=(minutes, minutes)), int(rng.integers(1 << 30)))
    noises = run_noise.noises(str(rng.choice(run_noise.KINDS)), d.row_s, rng)
    return runlog.columns(Plant(d), within_tolerance(rng, False), effects, noises, int(rng.integers(1 << 30)))


def root_of(normal: np.ndarray) -> np.ndarray:
    """A square root of a covariance that may be singular: some effects are one."""
    values, vectors = np.linalg.eigh(normal)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def pooled(seed: int) -> int:
    """Planted: fill loss that wears on two machines, one repaired; a leak of z 3 in each of 30 logs; a product."""
    failed: Failed = []
    machine = load("huanghai", MACHINE).model
    forms = evidence(drawn_log(20.0, (), 3), machine).forms
    (form,) = [one for one in forms if "flow.gain" in one.names]
    normal, names = np.array(form.normal), form.names
    root = root_of(normal)
    weak = "shaft.load_droop"
    (other,) = [one for one in forms if weak in one.names]
    weak_normal = np.array(other.normal)
    weak_root = root_of(weak_normal)
    at = other.names.index(weak)
    weak_size = WEAK_Z / weak_normal[at, at] ** 0.5
    rng, logs = np.random.default_rng(seed), []
    for number in range(MACHINES):
        name = f"m{number:02d}"
        for day in range(LOGS):
            product = PRODUCT if (day // 8 + number) % 3 == 0 else "urea"
            truth = {"flow.gain": 3.0 if product == PRODUCT else 0.0}
            if name in WEAR:
                truth["flow.fill_falloff"] = 0.3 * day
            if name == REPAIR:
                truth["flow.fill_falloff"] = 0.4 * day if day < 30 else 0.0
            x = np.array([truth.get(one, 0.0) for one in names])
            y = np.zeros(len(other.names))
            if name == WEAK and day < WEAK_LOGS:
                y[at] = weak_size
            if name == WEAK and day >= WEAK_LOGS:
                continue
            right = normal @ x + root @ rng.normal(size=len(x))
            pull = weak_normal @ y + weak_root @ rng.normal(size=len(y))
            logs.append(OneLog(f"{name}-{day}", name, float(day), (
                Form(names, form.normal, tuple(right)), Form(other.names, other.normal, tuple(pull))),
                {"product": product, "operator": f"o{number % 5}"}))
    begin = time.process_time()
    found, shared = courses(logs)
    print(f"{len(logs)} logs of {MACHINES} machines put together in {time.process_time() - begin:.1f} s of processor")
    named = {(one.machine, one.effect): one for one in found}
    for machine_name in WEAR:
        one = named.get((machine_name, "flow.fill_falloff"))
        check(failed, one is not None and wears(one) and abs(one.pieces[-1].per_day - 0.3) < 0.06,
              f"wear of {machine_name}: 0.30 a day planted, {_slope(one)} told")
    one = named.get((REPAIR, "flow.fill_falloff"))
    repairs = [] if one is None else repaired_d(one)
    check(failed, bool(repairs) and abs(repairs[0] - 29.5) < 1.6, f"repair of {REPAIR} at day 29.5: told {repairs}")
    one = named.get((WEAK, weak))
    check(failed, one is not None and abs(one.mean - weak_size) < 2.0 * one.mean_half,
          f"{weak} {weak_size:.3f} (z {WEAK_Z:g} in each of {WEAK_LOGS} logs): told "
          f"{'nothing' if one is None else f'{one.mean:.3f} +- {one.mean_half:.3f}, gain {one.gain:.0f}'}")
    said = [one for one in shared if one.factor == "product"]
    check(failed, any(one.level in (PRODUCT, "urea") and abs(abs(one.size) - 3.0) < 2.0 * one.half for one in said),
          f"product {PRODUCT}: flow 3 % more planted; told {[(o.level, o.effect, round(o.size, 2)) for o in said]}")
    planted = {(m, "flow.fill_falloff") for m in (*WEAR, REPAIR)} | {(WEAK, weak)}
    strange = [key for key in named if key not in planted and key[1] not in ("flow.gain", "scale.gain")]
    check(failed, len(strange) <= 1, f"effects told that were not planted: {strange}")
    check(failed, not any(one.factor == "operator" for one in shared), "no operator is blamed")
    return 1 if failed else 0


def _slope(one: Course | None) -> str:
    return "nothing" if one is None else f"{one.pieces[-1].per_day:.2f}"


FLEET = {"seeder-a": 12, "seeder-b": 12, "seeder-c": 12, "seeder-d": 12}


def make(folder: Path, minutes: float) -> None:
    """a: fill loss that wears, repaired before the 9th log. b: a product with 5 % more flow. c: a wheel 0.3 % off, too
    weak for a log; its operator lets the hopper run low. d: nothing."""
    for m, (name, count) in enumerate(FLEET.items()):
        for day in range(count):
            path = folder / name / f"{day:02d}.{'parquet' if day % 2 else 'csv'}"
            if path.exists():
                continue
            product = "compound" if day // 3 % 2 else "urea"
            effects = []
            if name == "seeder-a" and day < 8:
                effects.append(Effect("flow.fill_falloff", 3.0 + 2.0 * day, 0))
            if product == "compound":
                effects.append(Effect("flow.gain", 5.0, 0))
            if name == "seeder-c":
                effects.append(Effect("speed.wheel_radius", 0.3, 0))
            columns = drawn_log(minutes, tuple(effects), 100 * m + day)
            if name == "seeder-c":
                columns["hopper_kg"] = columns["hopper_kg"] - np.nanmin(columns["hopper_kg"]) + 1.0
            meta = run_meta(load("huanghai", MACHINE).model, started_utc=f"2026-04-{day + 1:02d}T08:00:00Z", extra={
                "unit": name, "product": product, "operator": "Wang" if name == "seeder-c" else "Li", "field": f"f{m}"})
            path.parent.mkdir(parents=True, exist_ok=True)
            write_store(path.with_suffix(".parquet"), columns, meta)
            if path.suffix == ".csv":
                from drivers.files.log_store import read_store, write_text
                stored = read_store(path.with_suffix(".parquet"))
                write_text(path, stored.columns, stored.meta)
                path.with_suffix(".parquet").unlink()
    (folder / "seeder-d" / "broken.csv").write_text("time_s,shaft_rpm\n0.0,\n")


def run(folder: Path, workers: int, kill: bool, out: Path) -> tuple[float, float]:
    """Seconds of `topdress fleet`, and the most memory that one of its workers took, MB."""
    import psutil
    begin = time.monotonic()
    child = subprocess.Popen(
        [sys.executable, "-c", "from console.cli import main; main()", "fleet", str(folder), "--out", str(out),
         "--workers", str(workers), "--price", "3"], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)})
    most, killed, before = 0.0, False, len(list((out / "logs").glob("*.json")))
    while child.poll() is None:
        time.sleep(0.5)
        with_memory = []
        for one in psutil.Process(child.pid).children(recursive=True) if child.poll() is None else []:
            try:
                with_memory.append((one.memory_info().rss / 1e6, one.pid, " ".join(one.cmdline())))
            except psutil.Error:
                continue
        busy = [one for one in with_memory if "spawn_main" in one[2]]
        most = max([most, *(one[0] for one in busy)])
        done = len(list((out / "logs").glob("*.json")))
        if kill and not killed and done >= before + 4 and busy:
            os.kill(max(busy)[1], signal.SIGKILL)
            killed = True
            print(f"  one worker was killed after {done} logs")
    if child.returncode:
        raise SystemExit(f"topdress fleet ended with code {child.returncode}")
    return time.monotonic() - begin, most


def told(folder: Path, out: Path, failed: Failed) -> None:
    import polars as pl
    logs = pl.read_parquet(out / "logs.parquet")
    check(failed, logs.height == sum(FLEET.values()), f"{logs.height} of {sum(FLEET.values())} logs are in the result")
    pieces = pl.read_parquet(out / "pieces.parquet").to_dicts()
    shared = pl.read_parquet(out / "shared.parquet").to_dicts()
    print("  pieces:")
    for one in pieces:
        print(f"    {one['machine']} {one['effect']:22} {one['begin']:+.2f} to {one['end']:+.2f} "
              f"(+-{one['end_half']:.2f})")
    for one in shared:
        print("    shared", one)
    fill = [one for one in pieces if one["machine"] == "seeder-a" and one["effect"] == "flow.fill_falloff"]
    check(failed, len(fill) >= 2 and fill[0]["end"] > 10.0 and abs(fill[-1]["end"]) < 3.0,
          "wear and repair of seeder-a")
    wheel = [one for one in pieces if one["machine"] == "seeder-c" and one["effect"].startswith("speed.wheel")]
    check(failed, bool(wheel), "wheel of seeder-c, too weak for one log")
    check(failed, any(one["factor"] == "product" for one in shared), "product that flows more")
    page = (out / "report.html").read_text()
    check(failed, "Wang" in page, "operator who lets the hopper run low")
    check(failed, "broken.csv" in page, "the broken log is listed")


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("pooled", "logs", "run"))
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kill", action="store_true")
    parser.add_argument("--workers", type=int, nargs="+", default=[2])
    given = parser.parse_args()
    if given.what == "pooled":
        return pooled(given.seed)
    assert given.folder is not None
    if given.what == "logs":
        make(given.folder, given.minutes)
        return 0
    failed: Failed = []
    for workers in given.workers:
        out = given.folder.with_name(f"{given.folder.name}-out{workers}")
        seconds, memory = run(given.folder, workers, given.kill, out)
        worked = [json.loads(one.read_text()) for one in (out / "logs").glob("*.json")]
        print(f"{workers} workers: {seconds:.0f} s for {len(worked)} logs, {memory:.0f} MB at most in one worker")
        told(given.folder, out, failed)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

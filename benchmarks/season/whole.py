"""The commands of benchmarks/fleet.py that diagnose real rows."""
from __future__ import annotations

import functools
import http.server
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from hidden.nominal import Physics
from hidden.plant import Plant
from season.judged import Checks, Reported, judge, kilograms
from season.logs import driven, effects_of, long_log
from season.ran import ENVIRONMENT, ROOT, Ran, done_in, ran, records_in
from season.truth import DAYS, MACHINES, PLANTED, WRONG_CLOCK, days

from console.services.fleet_season import season
from control.machine.machine import Machine

LONG_ROWS = 1_000_000
BROKEN = 5


def run(folder: Path, out: Path, workers: int, checks: Checks) -> None:
    one = ran([str(folder)], out, "--workers", str(workers))
    print(one.said.strip())
    print(f"{workers} workers: {one.seconds:.0f} s, {one.processor_s:.0f} s of processor, {one.memory_mb:.0f} MB at "
          f"most in one worker, {one.memory_of_command_mb:.0f} MB in the command")
    reported(out, 6.0, checks)


def reported(out: Path, minutes: float, checks: Checks) -> None:
    """Truth against the records in `out`."""
    every = [{"key": path.stem, **one} for path, one in zip(done_in(out), records_in(out), strict=True)]
    records = [one for one in every if "error" not in one]
    broken = [(one["path"], one["error"]) for one in every if "error" in one]
    checks.that(len(records) == MACHINES * DAYS, f"{len(records)} of {MACHINES * DAYS} logs are in the result")
    checks.that(len(broken) == BROKEN and all("\n" not in why for _, why in broken),
                f"{len(broken)} of {BROKEN} broken logs are listed, a line each")
    begin = time.process_time()
    found = season(records, broken, time.time() / 86_400.0)
    print(f"put together in {time.process_time() - begin:.1f} s of processor")
    judge(Reported(found.fit.courses, found.fit.shared, found.low), checks)
    checks.that(len(found.machines) == MACHINES, f"{len(found.machines)} machines, however their names are spelt")
    aside = {one.path.replace("\\", "/") for one in found.aside}
    checks.that(len(aside) == len(WRONG_CLOCK) and all(any(f"{machine}/{day:02d}." in path for path in aside)
                for machine, day in WRONG_CLOCK), f"logs whose clock was wrong are said: {sorted(aside)}")
    kilograms(found.machines, _wrong_kg(records, minutes), checks)


def _wrong_kg(records: list[dict[str, Any]], minutes: float) -> dict[str, float]:
    """By machine, where nothing but its flow is off: what left the outlets against the nominal machine's."""
    others = {one.machine for one in PLANTED if not one.effect.startswith("flow.")}
    applied = {(Path(one["path"]).parent.name, int(Path(one["path"]).stem)): one["worked"]["applied_kg"]
               for one in records}
    wrong: dict[str, float] = {}
    for day in days():
        if day.machine not in others and (day.machine, day.day) not in WRONG_CLOCK:
            plant = Plant(driven(day, minutes)[0])
            flow = [float(plant.run(Physics(), effects)["true_flow"].sum()) for effects in ((), effects_of(day))]
            kg = applied.get((day.machine, day.day), 0.0)
            wrong[day.machine] = wrong.get(day.machine, 0.0) + kg * abs(flow[1] / flow[0] - 1.0)
    return wrong


def _first(folder: Path, count: int) -> list[str]:
    """So many logs, text and Parquet, of all machines in turn."""
    logs = sorted((path for path in folder.glob("m*/*") if path.suffix in (".csv", ".parquet")),
                  key=lambda path: (path.stem, path.parent.name))
    return [str(path) for path in logs[:count]]


def _fresh(folder: Path, name: str) -> Path:
    out = folder.with_name(f"{folder.name}-{name}")
    shutil.rmtree(out, ignore_errors=True)
    return out


def scaling(folder: Path, count: int, checks: Checks) -> None:
    logs, seconds = _first(folder, count), dict[int, Ran]()
    for workers in (1, 2):
        out = _fresh(folder, f"workers{workers}")
        load = os.getloadavg()[0]
        one = seconds[workers] = ran(logs, out, "--workers", str(workers))
        records = records_in(out)
        inside = sum(record["took_s"] for record in records)
        processor = sum(record["processor_s"] for record in records)
        work = float(one.said.rsplit(";", 1)[1].split()[0])
        print(f"{workers} workers, {len(records)} logs: {one.seconds:.0f} s, {work:.0f} s of them cluster and work; "
              f"in `record` {inside:.0f} s by the wall, {processor:.0f} s of processor "
              f"({processor / len(records):.2f} a log); workers took {one.processor_s:.0f} s of processor; load before "
              f"{load:.1f}")
        print(f"  overhead: {100.0 * (1.0 - inside / (workers * work)):.1f} % of the workers' time by the wall, "
              f"{100.0 * (1.0 - processor / one.processor_s):.1f} % of their processor (imports, checksums, Dask)")
        checks.that(len(records) == count, f"{len(records)} of {count} logs with {workers} workers")
    one, two = (float(seconds[k].said.rsplit(";", 1)[1].split()[0]) for k in (1, 2))
    print(f"1 to 2 workers: {one / two:.2f} times as fast by the wall (efficiency {50.0 * one / two:.0f} %)")


def killed(folder: Path, count: int, checks: Checks) -> None:
    logs = _first(folder, count)
    out = _fresh(folder, "killed")
    one = ran(logs, out, "--workers", "2", kill_worker_after=5)
    checks.that(len(records_in(out)) == count and not [each for each in records_in(out) if "error" in each],
                f"a worker killed after {one.killed} logs: {len(records_in(out))} of {count} logs, "
                f"{sum('error' in each for each in records_in(out))} broken")
    out = _fresh(folder, "started")
    first = ran(logs, out, "--workers", "2", kill_all_after=count // 3)
    kept = {path.name: path.stat().st_mtime_ns for path in done_in(out)}
    again = ran(logs, out, "--workers", "2")
    after = {path.name: path.stat().st_mtime_ns for path in done_in(out)}
    checks.that(len(after) == count and all(after[name] == kept[name] for name in kept),
                f"the whole command killed after {first.killed} logs and run again: {len(after)} of {count}, none of "
                f"the {len(kept)} done again ({again.said.strip().splitlines()[-1]})")
    once = ran(logs, out, "--workers", "2")
    checks.that(f"({count} before)" in once.said, f"once more: {once.said.strip().splitlines()[-1]}")


def long(folder: Path, count: int, machine: Machine, checks: Checks) -> None:
    path = folder.with_name(f"{folder.name}-long.parquet")
    long_log(path, LONG_ROWS, machine)
    out = _fresh(folder, "long-out")
    one = ran([*_first(folder, count), str(path)], out, "--workers", "2")
    records = records_in(out)
    rows = {each["path"]: each.get("rows", 0) for each in records}
    whole = next(each for each in records if each["path"] == str(path))
    print(f"{len(records)} logs, {sum(rows.values())} rows: {one.seconds:.0f} s; {one.memory_mb:.0f} MB at most in one "
          f"worker, {one.memory_of_command_mb:.0f} MB in the command")
    checks.that(whole.get("rows") == LONG_ROWS, f"a log of {LONG_ROWS} rows ({path.stat().st_size / 1e6:.0f} MB): "
                f"{whole.get('error') or f'''{whole['took_s']:.0f} s, {whole['processor_s']:.0f} s of processor'''}")
    checks.that(len(records) == count + 1 and not [each for each in records if "error" in each], "none is lost")


def elsewhere(folder: Path, count: int, checks: Checks) -> None:
    """The same logs on this computer, on a cluster by its address, by file:// and by http://."""
    logs = _first(folder, count)
    here = _fresh(folder, "here")
    ran(logs, here, "--workers", "1")
    port = _free_port()
    scheduler = _dask("scheduler", "--port", str(port), "--no-dashboard")
    worker = _dask("worker", f"tcp://127.0.0.1:{port}", "--nworkers", "2", "--nthreads", "1", "--no-dashboard")
    served = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(folder)))
    threading.Thread(target=served.serve_forever, daemon=True).start()
    try:
        address = f"tcp://127.0.0.1:{port}"
        http_at = f"http://127.0.0.1:{served.server_address[1]}"
        urls = {"scheduler by hand": logs, "file:// by hand": [f"file://{path}" for path in logs],
                "http:// by hand": [f"{http_at}/{Path(path).relative_to(folder)}" for path in logs]}
        for name, paths in urls.items():
            out = _fresh(folder, "elsewhere")
            one = ran(paths, out, "--scheduler", address)
            checks.that(_same(records_in(here), records_in(out)), f"{name}: {len(records_in(out))} of {count} logs in "
                        f"{one.seconds:.0f} s, records as on this computer")
    finally:
        served.shutdown()
        for process in (worker, scheduler):
            process.terminate()
            process.wait(30)


def _same(one: list[dict[str, object]], other: list[dict[str, object]]) -> bool:
    """The same records, but for the path and the time that they took."""
    def plain(of: list[dict[str, object]]) -> list[tuple[object, ...]]:
        return sorted(((each["unit"], each["time_d"], each["verdict"], str(each["forms"])) for each in of), key=str)
    return len(one) == len(other) and all("error" not in each for each in (*one, *other)) and plain(one) == plain(other)


def _dask(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "dask", *arguments], env=ENVIRONMENT, cwd=ROOT,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *arguments: object) -> None:
        pass

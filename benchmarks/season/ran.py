"""`topdress fleet` run and watched: seconds, memory of its workers, workers killed, the whole command killed."""
from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import psutil

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-c", "from console.cli import main; main()", "fleet"]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
EVERY_S = 0.25


class Ran(NamedTuple):
    """memory_mb: the most that one worker took; memory_of_command_mb: the command's own, with the scheduler."""

    seconds: float
    memory_mb: float
    memory_of_command_mb: float
    processor_s: float
    killed: int
    said: str


def done_in(out: Path) -> list[Path]:
    return sorted((out / "logs").glob("*.json"))


def records_in(out: Path) -> list[dict[str, Any]]:
    return [json.loads(path.read_text(encoding="utf-8")) for path in done_in(out)]


def ran(paths: Sequence[str], out: Path, *more: str, kill_worker_after: int = 0, kill_all_after: int = 0) -> Ran:
    """Runs the command to its end, or kills it whole after so many logs (SIGKILL); one worker after so many."""
    begin, before = time.monotonic(), len(done_in(out))
    child = subprocess.Popen([*COMMAND, *paths, "--out", str(out), "--price", "3", *more], cwd=ROOT, env=ENVIRONMENT,
                             stderr=subprocess.PIPE, text=True)
    most = own = 0.0
    killed, spent = 0, dict[int, float]()
    while child.poll() is None:
        time.sleep(EVERY_S)
        workers = _workers(child.pid)
        for one, memory_mb, cpu_s in workers:
            most, spent[one] = max(most, memory_mb), cpu_s
        own = max(own, _memory_mb(child.pid))
        done = len(done_in(out)) - before
        if kill_worker_after and not killed and done >= kill_worker_after and workers:
            os.kill(max(workers, key=lambda one: one[1])[0], signal.SIGKILL)
            killed = done
        if kill_all_after and done >= kill_all_after:
            family = [child.pid, *(one.pid for one in psutil.Process(child.pid).children(recursive=True))]
            for pid in family:
                os.kill(pid, signal.SIGKILL)
            killed = done
            break
    said = child.communicate()[1]
    if child.returncode and not kill_all_after:
        raise SystemExit(f"topdress fleet ended with code {child.returncode}: {said[-2000:]}")
    return Ran(time.monotonic() - begin, most, own, sum(spent.values()), killed, said)


def _workers(pid: int) -> list[tuple[int, float, float]]:
    """Processes that Dask's nannies started: number, MB, seconds of processor."""
    found = []
    try:
        children = psutil.Process(pid).children(recursive=True)
    except psutil.Error:
        return []
    for one in children:
        try:
            if "spawn_main" in " ".join(one.cmdline()):
                spent = one.cpu_times()
                found.append((one.pid, one.memory_info().rss / 1e6, spent.user + spent.system))
        except psutil.Error:
            continue
    return found


def _memory_mb(pid: int) -> float:
    try:
        return psutil.Process(pid).memory_info().rss / 1e6
    except psutil.Error:
        return 0.0

"""From one computer to many: `topdress fleet` over drawn logs in an object store, on a cluster
of processes.

The store is a server that answers fsspec over HTTP: a folder of each machine, a log an object,
requests and bytes counted, each answer after `--latency-ms` as a store far away. A log's bytes
are its record as `drawn.py` draws it, and in the place of a diagnosis a worker reads them. All
else is what a fleet really does, in processes of their own: the command, a Dask scheduler,
`--workers` of one thread.

    python -m benchmarks season/many --logs 1000 10000 100000 [--model] [--cut 0.5] \\
        [--latency-ms 5] [--together 16]

For each number the command three times: killed (SIGKILL) when a share `--cut` of the records is
there; the same again, which goes on; and once more, with nothing to do. `--model`: the second
puts the logs together too (else none does; its time is that of season/drawn). `--files`: the
store is a folder, nothing counted. `--together`: so many records to a task, for a machine that
has other work to do; what a task costs shows with one to a task, as a fleet has them. Exit code
1 where a run does not end with every log, or a log is read for nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent), str(HERE.parents[1])]

from verdict import exit_code  # noqa: E402

FIRST_D = 20_500.0  # days since 1970 of the first log
LOOK_S = 0.5
PERCENT = {
    "flow.gain": 1.0,
    "scale.gain": -1.0,
    "flow.fill_falloff": -0.5,
    "gate.offset": 2.0,
    "shaft.gain": 1.0,
    "speed.wheel_radius": 0.5,
}  # of the dose by one unit
COUNTS = "/counts"


def read(
    where: str, options: Mapping[str, str], machine: Mapping[str, Any], *more: Any
) -> dict[str, Any]:
    """In the place of a diagnosis, on a worker: the record that lies there."""
    from topdress.console.services.fleet_job import open_local_copy

    with open_local_copy(where, options, *more) as path:
        return {**json.loads(path.read_bytes()), "path": where}


def bodies(seed: int, count: int) -> Iterator[tuple[str, bytes]]:
    """Place and bytes of every log."""
    from drawn import season_of
    from topdress.console.services.fleet_job import FORMAT

    for number, one in enumerate(season_of(seed, count)):
        form = {
            name: value.tolist() if hasattr(value, "tolist") else value
            for name, value in one.form.items()
        }
        made = {
            "format": FORMAT,
            "path": "",
            "content": str(number),
            "rows": 3600,
            "duration_s": 3600.0,
            "model": "huanghai",
            "nominal": "",
            "unit": one.machine,
            "time_d": FIRST_D + one.time_d,
            "time_from": "log",
            "shared": one.shared,
            "verdict": "healthy",
            "percent": PERCENT,
            "worked": {
                "hours": 1.0,
                "applied_kg": 900.0,
                "area_ha": 3.0,
                "low_minutes": 1.0,
                "refills": 2,
            },
            "units": dict.fromkeys(form["names"], "%"),
            "causes": [],
            "forms": [form],
        }
        yield f"season/{one.machine}/{number:06d}.csv", json.dumps(made).encode()


class Store:
    """Objects by their place over HTTP, and pages of links for folders; what was asked is
    counted."""

    def __init__(self, objects: Mapping[str, bytes], latency_s: float) -> None:
        self.objects, self.latency_s, self.asked = objects, latency_s, Counter[str]()
        self.folders: dict[str, set[str]] = {}
        for place in objects:
            parts = place.split("/")
            for k in range(1, len(parts)):
                self.folders.setdefault("/".join(parts[:k]), set()).add(
                    parts[k] + ("/" if k < len(parts) - 1 else "")
                )

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
            while head := await reader.readuntil(b"\r\n\r\n"):
                method, place = head.split(b" ", 2)[:2]
                status, kind, body = self.answer(place.decode())
                if self.latency_s:
                    await asyncio.sleep(self.latency_s)
                header = (
                    f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: "
                    f"{len(body)}\r\n\r\n"
                )
                writer.write(header.encode() + (b"" if method == b"HEAD" else body))
                await writer.drain()
        writer.close()

    def answer(self, place: str) -> tuple[str, str, bytes]:
        if place == COUNTS:
            said, self.asked = self.asked, Counter[str]()
            return "200 OK", "application/json", json.dumps(said).encode()
        name = place.strip("/")
        if (found := self.objects.get(name)) is not None:
            status, kind, body = "200 OK", "application/octet-stream", found
        elif (inside := self.folders.get(name)) is not None:
            body = "".join(f'<a href="{one}">{one}</a>\n' for one in sorted(inside)).encode()
            status, kind = "200 OK", "text/html"
        else:
            status, kind, body = "404 Not Found", "text/plain", b""
        what = "folders" if kind == "text/html" else "found" if found is not None else "missing"
        self.asked.update({what: 1, "bytes": len(body), f"{what}_bytes": len(body)})
        return status, kind, body


def stored(seed: int, count: int, port: int, latency_s: float) -> None:
    store = Store(dict(bodies(seed, count)), latency_s)

    async def run() -> None:
        server = await asyncio.start_server(store.serve, "127.0.0.1", port, backlog=256)
        print("ready", sum(map(len, store.objects.values())), flush=True)
        await server.serve_forever()

    asyncio.run(run())


def command(words: list[str], model: bool, together: int) -> None:
    """`topdress fleet` in this process, with `read` in the place of a diagnosis; how long its
    parts take is printed."""
    import functools

    import many  # type: ignore[import-not-found]   # by its own name: workers load it by that
    from topdress.console.cli import app
    from topdress.console.services import fleet, fleet_season, fleet_tables
    from topdress.control.diagnosis.season.effect_timelines import SeasonFit

    def timed(what: str, work: Any) -> Any:
        @functools.wraps(work)
        def wrapped(*words: Any, **more: Any) -> Any:
            begin = time.monotonic()
            try:
                return work(*words, **more)
            finally:
                most_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
                print(
                    f"  {what} {time.monotonic() - begin:.1f} s, {most_mb} MB",
                    file=sys.stderr,
                    flush=True,
                )

        return wrapped

    fleet.find_logs = timed("listing", fleet.find_logs)
    fleet.diagnose_fleet = timed("logs", functools.partial(fleet.diagnose_fleet, record=many.read))
    twice = fleet._FleetTasks.run_with_retry
    fleet._FleetTasks.run_with_retry = lambda its, work, todo, several=1: twice(  # type: ignore[method-assign]
        its, work, todo, max(together, several)
    )
    if not model:
        fleet_season.fit_season = lambda logs: SeasonFit((), (), (), ())
    fleet_season.fit_season = timed("model", fleet_season.fit_season)
    fleet_season.make_season = timed("season, the model in it", fleet_season.make_season)
    fleet_tables.write_tables = timed("tables", fleet_tables.write_tables)
    app(["fleet", *words])


class Took(NamedTuple):
    """One run: seconds and processor seconds by wall and of each process, most memory, requests
    and bytes."""

    wall_s: float
    command_s: float
    command_mb: int
    said: str
    code: int
    asked: Mapping[str, int]
    scheduler_s: float
    scheduler_mb: int
    workers_s: float
    tasks: int


def process(pid: int) -> tuple[float, int]:
    """Seconds of processor so far, and the most memory in MB."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    status = Path(f"/proc/{pid}/status").read_text()
    return (
        (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"),
        int(status.split("VmHWM:")[1].split()[0]) // 1024,
    )


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Rig:
    """Store, scheduler, and workers as processes."""

    def __init__(self, given: argparse.Namespace, count: int, room: Path) -> None:
        self.given = given
        self.port, self.address, self.room = free_port(), f"tcp://127.0.0.1:{free_port()}", room
        self.env = {
            **os.environ,
            "OPENBLAS_NUM_THREADS": "1",
            "PYTHONPATH": os.pathsep.join(
                [
                    str(HERE.parents[1]),
                    str(HERE),
                    str(HERE.parent),
                    os.environ.get("PYTHONPATH", ""),
                ]
            ),
        }
        self.children = list[subprocess.Popen[str]]()
        if given.files:
            self.bytes, self.url = 0, f"file://{room}/season/"
            for place, data in bodies(given.seed, count):
                (room / place).parent.mkdir(parents=True, exist_ok=True)
                self.bytes += (room / place).write_bytes(data)
        else:
            wanted = given.seed, count, self.port, given.latency_ms / 1e3
            self.url = f"http://127.0.0.1:{self.port}/season/"
            store = self.child("-c", f"import many; many.stored{wanted}", stdout=subprocess.PIPE)
            assert store.stdout is not None
            self.bytes = int(store.stdout.readline().split()[1])
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.scheduler = self.child(
            "-m",
            "distributed.cli.dask_scheduler",
            "--host",
            self.address,
            "--no-dashboard",
            **quiet,
        )
        self.workers = [
            self.child(
                "-m",
                "distributed.cli.dask_worker",
                self.address,
                "--nthreads",
                "1",
                "--no-nanny",
                "--no-dashboard",
                "--local-directory",
                str(room),
                **quiet,
            )
            for _ in range(given.workers)
        ]

    def child(self, *words: str, **more: Any) -> subprocess.Popen[str]:
        self.children.append(
            subprocess.Popen([sys.executable, *words], env=self.env, text=True, **more)
        )
        return self.children[-1]

    def counts(self) -> dict[str, int]:
        import urllib.request

        if self.given.files:
            return {}
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{COUNTS}") as opened:
            return dict(json.loads(opened.read()))

    def run(self, out: Path, model: bool, cut_at: int | None = None) -> Took:
        from distributed import Client

        self.counts()
        before = process(self.scheduler.pid)[0], sum(process(one.pid)[0] for one in self.workers)
        words = [self.url, "--out", str(out), "--scheduler", self.address]
        begin, wanted = time.monotonic(), (words, model, self.given.together)
        child = self.child(
            "-c",
            f"import many; many.command{wanted}",
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        over, tasks, used = threading.Event(), [0], [0.0, 0]

        def watch() -> None:
            with Client(self.address, set_as_default=False) as client:
                while not over.wait(LOOK_S):
                    tasks[0] = max(
                        tasks[0],
                        client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)),
                    )
                    with contextlib.suppress(OSError, IndexError):
                        used[:] = process(child.pid)
                    if (
                        cut_at is not None
                        and (out / "logs").is_dir()
                        and len(os.listdir(out / "logs")) >= cut_at
                    ):
                        child.send_signal(signal.SIGKILL)

        watching = threading.Thread(target=watch)
        watching.start()
        said = child.communicate()[1]
        over.set()
        wall_s = time.monotonic() - begin
        watching.join()
        after, most_mb = process(self.scheduler.pid)
        return Took(
            wall_s,
            used[0],
            int(used[1]),
            said,
            child.returncode,
            self.counts(),
            after - before[0],
            most_mb,
            sum(process(one.pid)[0] for one in self.workers) - before[1],
            tasks[0],
        )

    def end(self) -> None:
        for one in self.children[::-1]:
            one.terminate()
            one.wait()


def report(what: str, one: Took, logs: int) -> None:
    print(
        f"{logs} logs, {what}: {one.wall_s:.1f} s ({1e3 * one.wall_s / logs:.2f} ms a log); "
        "processor: command "
        f"{one.command_s:.1f} s, scheduler {one.scheduler_s:.1f} s, workers "
        f"{one.workers_s:.1f} s; most memory: "
        f"command {one.command_mb} MB, scheduler {one.scheduler_mb} MB with {one.tasks} "
        "tasks; asked of the store: "
        + ", ".join(f"{value} {name}" for name, value in sorted(one.asked.items()))
    )
    print(
        "\n".join(
            line
            for line in one.said.splitlines()
            if line.startswith("  ") or "diagnosed" in line or (one.code and " of " not in line)
        ),
        flush=True,
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--logs", type=int, nargs="+", default=[990])
    parser.add_argument("--seed", type=int, default=3701)
    parser.add_argument("--cut", type=float, default=0.5)
    parser.add_argument("--latency-ms", type=float, default=0.0)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--together", type=int, default=1)
    parser.add_argument("--files", action="store_true")
    parser.add_argument("--model", action="store_true")
    given = parser.parse_args()
    promises: dict[str, bool] = {}
    for asked in given.logs:
        logs = asked // 30 * 30
        with tempfile.TemporaryDirectory(prefix="topdress-many-") as folder:
            rig, out = Rig(given, logs, Path(folder)), Path(folder) / "out"
            try:
                print(f"{logs} logs: {rig.bytes} bytes lie in the store", flush=True)
                cut = rig.run(out, False, int(given.cut * logs))
                report("killed", cut, logs)
                kept = sum(1 for _ in (out / "logs").glob("*.json"))
                again = rig.run(out, given.model)
                report(f"gone on with {kept} kept", again, logs)
                nothing = rig.run(out, False)
                report("nothing to do", nothing, logs)
                files = list((out / "logs").iterdir())
                print(
                    f"  in DIR/logs {len(files)} files, "
                    f"{sum(one.stat().st_size for one in files)} bytes; seen.json "
                    f"{(out / 'seen.json').stat().st_size} bytes",
                    flush=True,
                )
            finally:
                rig.end()
        promises |= {
            f"{logs}: killed on the way": cut.code != 0 and 0 < kept < logs,
            f"{logs}: the same command ends with all": again.code == 0
            and f"{logs} diagnosed ({kept} before)" in again.said,
            f"{logs}: once more reads no log": nothing.code == 0
            and f"({logs} before)" in nothing.said
            and nothing.asked.get("found_bytes", 0) == 0,
        }
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())

"""How are thousands of logs diagnosed on a Dask cluster, each once? Finished results are kept, even
if a process ends.

The output folder contains `logs/CHECKSUM.json`, a log's record by the checksum of its bytes, and
`seen.json`, the last known checksum of each file. A second run diagnoses only new logs. Records are
returned over the cluster and written here, so workers need access only to the logs.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import itertools
import json
import logging
import pkgutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from topdress.console.services.fleet_job import (
    FORMAT,
    StoreOptions,
    calc_checksum,
    hash_first_bytes,
    list_side_urls,
    make_record,
    read_first_line,
    read_record,
    run_each,
)
from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.optional_packages import require_extras

# Both names are a contract: a second run finds the finished work by them.
RECORDS_FOLDER, SEEN_FILES_NAME = "logs", "seen.json"
LOG_SUFFIXES = (".csv", ".parquet", ".pq")
# The truth of a simulated log lies next to the log and is no log itself.
SKIPPED_SUFFIXES = (".truth.csv",)
# Number of tasks in the cluster for each of its threads: few, so that cancelling is quick.
TASKS_PER_THREAD = 4
# Number of checksums in a task, because the checksum of a short log takes less time than a task.
CHECKSUMS_PER_TASK = 16
# Memory limit of a local worker.
# A worker beyond this limit restarts, so one huge log cannot exhaust the computer.
WORKER_MEMORY = "2GB"
# Dask returns memory at every 64 kB that are free. glibc then maps and unmaps each array above 128
# kB anew, which takes half of a diagnosis (mallopt(3): "dynamic mmap threshold"). None keeps the
# setting from outside, else glibc's own.
DASK_SETTINGS: dict[str, Any] = {
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    # The HTTP pages of the scheduler are not used.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
# Number of folders of which every worker reads a log's first bytes.
MAX_PROBED_FOLDERS = 100
# Time-outs for a scheduler, and for the first of its workers, s.
CONNECT_TIMEOUT_S, JOIN_TIMEOUT_S = 10.0, 30.0
# Interval at which the number of workers is checked, s.
WATCH_PERIOD_S = 2.0

SCHEDULER_GONE = "the scheduler is gone: what is done is kept; the same command goes on"
NO_WORKER_LEFT = "no worker is left: what is done is kept; the same command goes on"
# These loggers print tracebacks of faults that are reported here in one line.
NOISY_LOGGERS = ("distributed", "tornado", "asyncio")

# Arguments: finished logs, number of logs, description.
TellFleet = Callable[[int, int, str], None]


@dataclasses.dataclass(frozen=True, slots=True)
class FleetFindings:
    """Holds records by path, errors by path, the number of records known before, and the number of
    logs with the same bytes as others."""

    records: tuple[Mapping[str, Any], ...]
    broken: tuple[tuple[str, str], ...]
    known: int
    twins: int
    # A line for each worker that cannot read the logs and was excluded.
    blind: tuple[str, ...] = ()
    # A line for each worker that ended during the work.
    gone: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class FleetRequest:
    """Describes the work on every log. `options` are those of fsspec, for URLs; `retry` tries
    unreadable logs again."""

    machine: Mapping[str, Any]
    salt: str
    options: StoreOptions = dataclasses.field(default_factory=dict)
    retry: bool = False


@contextlib.contextmanager
def open_cluster(
    scheduler: str | None, workers: int, connect_s: float = CONNECT_TIMEOUT_S
) -> Iterator[Any]:
    """Opens a Dask client: of the scheduler at an address, else of workers on this computer. Raises
    MissingExtra, OSError.

    Every client of a Dask scheduler can run code as its user. Therefore the local scheduler accepts
    only clients with a certificate of an authority that was made for this run, and files of its
    workers are in a folder of this user.
    """
    require_extras("a fleet", "fleet", "diagnosis")
    import dask
    from distributed import Client, LocalCluster, Security

    # Loggers of libraries exist only after their import.
    for name in logging.root.manager.loggerDict:
        if name.startswith(NOISY_LOGGERS):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    if scheduler is not None:
        with _open_client(scheduler, Client, connect_s) as client:
            yield client
        return
    with tempfile.TemporaryDirectory(prefix="topdress-fleet-", ignore_cleanup_errors=True) as room:
        try:
            with _ignore_interrupts(), dask.config.set(DASK_SETTINGS):
                local = LocalCluster(
                    n_workers=workers,
                    # One thread for each worker: the diagnosis computes in numpy, where threads
                    # would compete.
                    threads_per_worker=1,
                    processes=True,
                    memory_limit=WORKER_MEMORY,
                    dashboard_address=None,
                    # The local address keeps the scheduler off the network.
                    host="127.0.0.1",
                    protocol="tls://",
                    security=Security.temporary(),
                    local_directory=room,
                )
        except RuntimeError as error:
            raise OSError(f"the workers of this computer did not start: {error}") from None
        with local, Client(local, set_as_default=False) as client:
            yield client


@contextlib.contextmanager
def _ignore_interrupts() -> Iterator[None]:
    """Keeps Ctrl-C from processes that begin here; this process ends them, without a traceback from
    each."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _open_client(scheduler: str, make: Callable[..., Any], connect_s: float) -> Iterator[Any]:
    """Opens a client of a running scheduler, with workers that can do the work. Raises OSError, in
    one line."""
    try:
        client = make(scheduler, set_as_default=False, timeout=connect_s)
    # For an unknown address Dask raises many kinds of errors.
    except Exception as error:
        why = (str(error).splitlines() or ["nobody answers"])[0]
        raise OSError(f"{scheduler}: no Dask scheduler: {why}") from None
    # Leaving this block closes the client only: the scheduler belongs to others.
    with client:
        try:
            client.wait_for_workers(1, timeout=JOIN_TIMEOUT_S)
        except TimeoutError:
            raise OSError(
                f"{scheduler}: no worker in {JOIN_TIMEOUT_S:.0f} s: allowed is a scheduler with at "
                "least one "
                f"(dask worker {scheduler})"
            ) from None
        for line in list_version_clashes(client.get_versions()):
            raise OSError(f"{scheduler}: {line}")
        for line in list_without_topdress(_read_record_formats(client)):
            raise OSError(f"{scheduler}: {line}")
        yield client


def _read_record_formats(client: Any) -> dict[str, Any]:
    """Returns the record format of the topdress installed on the scheduler and on each worker, by
    name; the exception where topdress is not installed."""
    asked = (pkgutil.resolve_name, f"{make_record.__module__}:FORMAT")
    answers = {
        f"worker {name}": said for name, said in client.run(*asked, on_error="return").items()
    }
    try:
        return {"the scheduler": client.run_on_scheduler(*asked), **answers}
    except ImportError as error:
        return {"the scheduler": error, **answers}


def list_without_topdress(formats: Mapping[str, Any]) -> Iterator[str]:
    """Returns one line for each worker without topdress, or with another format of records."""
    for who, said in formats.items():
        if isinstance(said, BaseException):
            yield (
                f"{who} has no topdress: allowed is the same as here on the scheduler and "
                "every worker"
            )
        elif said != FORMAT:
            yield f"{who} has a topdress that makes records {said}: allowed {FORMAT}"


def list_version_clashes(versions: Mapping[str, Any]) -> Iterator[str]:
    """Returns one line for each reason why a scheduler or worker cannot work with this program.

    `versions` are those of Dask's own report.
    """
    here = versions["client"]
    others = {
        "the scheduler": versions["scheduler"],
        **{f"worker {name}": said for name, said in versions["workers"].items()},
    }
    for who, said in others.items():
        if not said:
            yield f"{who} does not tell its versions"
            continue
        # Both packages define the wire format of tasks.
        for package in ("distributed", "cloudpickle"):
            if said["packages"].get(package) != here["packages"].get(package):
                yield (
                    f"{who} has {package} {said['packages'].get(package)}, here is "
                    f"{here['packages'].get(package)}: "
                    "allowed is the same"
                )
        # The last number of a Python version does not change its pickles.
        if said["host"]["python"].split(".")[:2] != here["host"]["python"].split(".")[:2]:
            yield (
                f"{who} runs Python {said['host']['python']}, here is "
                f"{here['host']['python']}: allowed is the same "
                "but for its last number"
            )


def find_logs(paths: Sequence[str], out: Path, options: StoreOptions | None = None) -> list[str]:
    """Returns files, the logs in folders at any depth, and the logs of patterns and fsspec URLs;
    each once, in order.

    Of the files in `out` only those named explicitly are included, so that they are refused before
    they are overwritten. Raises OSError for a missing path.
    """
    found: list[str] = []
    for where in paths:
        if "://" in where:
            found += _list_url_logs(where, options or {})
        elif Path(where).is_dir():
            found += [
                str(file)
                for file in sorted(Path(where).rglob("*"))
                if _is_log_name(file.name) and file.is_file()
            ]
        elif any(sign in where for sign in "*?["):
            import glob

            found += sorted(
                file for file in glob.glob(where, recursive=True) if Path(file).is_file()
            )
        elif Path(where).exists():
            found.append(where)
        else:
            raise FileNotFoundError(2, "no such file or folder", where)
    own, named = out.resolve(), set(paths)
    return [
        log
        # Each log is diagnosed once even if several patterns name it.
        for log in dict.fromkeys(found)
        if "://" in log or log in named or own not in Path(log).resolve().parents
    ]


def _is_log_name(name: str) -> bool:
    return (
        name.lower().endswith(LOG_SUFFIXES)
        and not name.lower().endswith(SKIPPED_SUFFIXES)
        and not name.startswith(".")
    )


def _list_url_logs(where: str, options: StoreOptions) -> list[str]:
    require_extras("a URL", "fleet")
    import fsspec

    system, path = fsspec.core.url_to_fs(where, **options)
    if any(sign in path for sign in "*?["):
        names = system.glob(path)
    else:
        names = system.find(path) if system.isdir(path) else [path]
    return [
        system.unstrip_protocol(name)
        for name in sorted(names)
        if _is_log_name(name.split("/")[-1]) or name == path
    ]


def diagnose_fleet(
    client: Any,
    paths: Sequence[str],
    asked: FleetRequest,
    out: Path,
    tell: TellFleet,
    record: Callable[..., dict[str, Any]] = make_record,
) -> FleetFindings:
    """Returns every log's record, as `record` makes it. KeyboardInterrupt passes through: finished
    records are kept.

    Only workers that can read the logs get tasks. A fault that is not the log's own is tried once
    more at the end, and is never kept, so that the next run tries again. Raises OSError where no
    worker can read the logs.
    """
    (out / RECORDS_FOLDER).mkdir(parents=True, exist_ok=True)
    # A known state of a file (time, size) saves reading its bytes for a checksum.
    seen = _read_seen_files(out)
    found = _find_file_states(paths, asked.options)
    marks = {path: state and f"{state} {asked.salt}" for path, (state, _sides) in found.items()}
    keys = {
        path: seen[path][1]
        for path in paths
        if path in seen and seen[path][0] == marks[path] and marks[path]
    }
    unknown = [path for path in paths if path not in keys]
    errors: dict[str, str] = {}
    kept: dict[str, dict[str, Any]] = {}
    blind: dict[str, str] = {}
    gone: list[str] = []
    try:
        blind = _find_blind_workers(
            client,
            [
                path
                for path in paths
                if asked.retry
                or path not in keys
                or not _make_record_path(out, keys[path]).is_file()
            ],
            asked.options,
        )
        work = _FleetTasks(client, [who for who in client.nthreads() if who not in blind])
        gone = work.gone
        for number, (path, key, why) in enumerate(
            work.run_with_retry(
                calc_checksum,
                {
                    path: (_make_absolute(path), asked.options, asked.salt, found[path][1])
                    for path in unknown
                },
                CHECKSUMS_PER_TASK,
            )
        ):
            if why:
                errors[path] = why
            else:
                keys[path] = key
                seen[path] = (marks[path], key)
            tell(number + 1, len(unknown), "looking at the files")
        _write_seen_files(out, seen)
        # Logs with equal bytes are diagnosed once, under the first path.
        first: dict[str, str] = {}
        for path, key in keys.items():
            first.setdefault(key, path)
        kept = {
            key: one
            for key in first
            if (one := _read_kept_record(out, key)) is not None
            and not (asked.retry and "error" in one)
        }
        todo = {path: key for key, path in first.items() if key not in kept}
        known = len(kept)
        for number, (path, made, why) in enumerate(
            work.run_with_retry(
                record,
                {
                    path: (_make_absolute(path), asked.options, asked.machine, found[path][1])
                    for path in todo
                },
            )
        ):
            # These logs crashed every worker, or failed for a reason outside of the log.
            if why:
                errors[path] = why
            elif "://" not in path and _find_file_state(path) != found[path][0]:
                errors[path] = "it was written while it was read: the same command reads it again"
                seen.pop(path, None)
            else:
                text = json.dumps({**made, "path": path})
                # A record that a power loss destroys is made again.
                write_atomically(_make_record_path(out, todo[path]), text, kept=False)
                kept[todo[path]] = read_record(text)
            tell(known + number + 1, len(first), "diagnosing")
    finally:
        _write_seen_files(out, seen)
    every = [{"key": key, **kept[key], "path": path} for key, path in first.items() if key in kept]
    # The reversed list keeps the first of several records with equal content.
    records = list({one.get("content", one["key"]): one for one in reversed(every)}.values())[::-1]
    broken = [*errors.items(), *((one["path"], one["error"]) for one in records if "error" in one)]
    twins = len(keys) - len(first) + len(every) - len(records)
    return FleetFindings(
        tuple(one for one in records if "error" not in one),
        tuple(sorted(broken)),
        known,
        twins,
        tuple(
            f"{who} does not see the logs, and is left out: {why}"
            for who, why in sorted(blind.items())
        ),
        tuple(f"worker {who} ended at work: others did its logs" for who in gone),
    )


def _make_absolute(path: str) -> str:
    """Returns a path that does not depend on the working folder, because a worker's folder
    differs."""
    return path if "://" in path else str(Path(path).absolute())


def _find_blind_workers(client: Any, paths: Sequence[str], options: StoreOptions) -> dict[str, str]:
    """Returns the workers that do not read the same first bytes of a log of every folder, with the
    reason.

    Raises OSError where none does.
    """
    one_of_each = {path.replace("\\", "/").rpartition("/")[0]: path for path in reversed(paths)}
    blind: dict[str, str] = {}
    for path in list(one_of_each.values())[:MAX_PROBED_FOLDERS]:
        here = hash_first_bytes(_make_absolute(path), options)
        # The log is missing or broken, and is listed as such.
        if here[1]:
            continue
        for who, said in client.run(
            hash_first_bytes, _make_absolute(path), options, on_error="return"
        ).items():
            if said != here:
                # Otherwise the result is the worker's own error.
                why = said[1] if isinstance(said, tuple) else str(said)
                blind.setdefault(f"worker {who}", why or f"{path} holds other bytes there")
    if blind and len(blind) >= len(client.nthreads()):
        who, why = min(blind.items())
        raise OSError(
            f"no worker sees the logs: {who}: {why}: allowed are paths and URLs that every "
            "worker reads"
        )
    return {who.removeprefix("worker "): why for who, why in blind.items()}


def _read_kept_record(out: Path, key: str) -> dict[str, Any] | None:
    """Returns a record of an earlier run; None for a missing or unreadable record."""
    try:
        made = read_record(_make_record_path(out, key).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return made if isinstance(made, dict) and made.get("format") == FORMAT else None


class _FleetTasks:
    """Submits tasks to the workers that can read the logs. If all can, workers that join later get
    tasks too."""

    def __init__(
        self,
        client: Any,
        workers: Sequence[str],
        join_s: float = JOIN_TIMEOUT_S,
        look_s: float = WATCH_PERIOD_S,
    ) -> None:
        self._client, self._join_s, self._look_s = client, join_s, look_s
        threads = client.nthreads()
        self._there = set(threads)
        # Addresses of the workers that ended while tasks remained.
        self.gone: list[str] = []
        self._room = max(1, TASKS_PER_THREAD * sum(threads.get(who, 1) for who in workers))
        self._where: dict[str, Any] = (
            {} if len(workers) == len(threads) else {"workers": list(workers)}
        )

    def run_with_retry(
        self, work: Callable[..., Any], todo: Mapping[str, tuple[Any, ...]], together: int = 1
    ) -> Iterator[tuple[str, Any, str]]:
        """Runs as `run_once`; a task that failed for a reason outside of its log is repeated alone
        at the end."""
        again: dict[str, tuple[Any, ...]] = {}
        for path, made, why in self.run_once(work, todo, together):
            if why:
                again[path] = todo[path]
            else:
                yield path, made, why
        yield from self.run_once(work, again)

    def run_once(
        self, work: Callable[..., Any], todo: Mapping[str, tuple[Any, ...]], together: int = 1
    ) -> Iterator[tuple[str, Any, str]]:
        """Yields (path, result, "") or (path, None, reason) as tasks finish; tasks of a crashed
        worker go to another.

        `together` is the number of logs in a task, where each worker has several.
        """
        from distributed import as_completed
        from distributed.comm.core import CommClosedError

        waiting = iter(todo.items())
        together = max(1, min(together, len(todo) // self._room))
        running: dict[Any, list[str]] = {}
        done = as_completed(loop=self._client.loop)

        def submit_next() -> None:
            if some := dict(itertools.islice(waiting, together)):
                future = self._client.submit(
                    run_each, work, list(some.values()), pure=False, **self._where
                )
                running[future] = list(some)
                done.add(future)

        for _ in range(min(self._room, len(todo))):
            submit_next()
        over, alone = threading.Event(), threading.Event()
        threading.Thread(
            target=self._watch_workers, args=(running, over, alone), daemon=True
        ).start()
        try:
            for futures in done.batches():
                if any(future.status == "cancelled" for future in futures):
                    raise OSError(NO_WORKER_LEFT if alone.is_set() else SCHEDULER_GONE)
                whole = [future for future in futures if future.status == "finished"]
                # All finished results are fetched at once.
                results = dict(zip(whole, self._client.gather(whole), strict=True))
                for future in futures:
                    paths = running.pop(future)
                    made = results.get(future) or [
                        (None, read_first_line(future.exception()))
                    ] * len(paths)
                    future.release()
                    submit_next()
                    for path, (result, why) in zip(paths, made, strict=True):
                        yield path, result, why
        except (CommClosedError, CancelledError):
            raise OSError(SCHEDULER_GONE) from None
        finally:
            over.set()
            with contextlib.suppress(CommClosedError, CancelledError):
                self._client.cancel(list(running))

    def _watch_workers(
        self, running: Mapping[Any, Any], over: threading.Event, alone: threading.Event
    ) -> None:
        """Records workers that end. If no worker remains and none joins within the time-out of the
        first worker, the tasks are cancelled, because they would never run."""
        missed = 0.0
        while not over.wait(self._look_s):
            # A lost scheduler shows in its tasks.
            with contextlib.suppress(Exception):
                there = set(self._client.nthreads())
                self.gone += sorted(self._there - there)
                self._there = there
                missed = 0.0 if there else missed + self._look_s
            if missed >= self._join_s:
                alone.set()
                with contextlib.suppress(Exception):
                    self._client.cancel(list(running), force=True)
                return


def _make_record_path(out: Path, key: str) -> Path:
    return out / RECORDS_FOLDER / f"{key}.json"


def _read_seen_files(out: Path) -> dict[str, tuple[str, str]]:
    try:
        answers = json.loads((out / SEEN_FILES_NAME).read_text(encoding="utf-8"))
        return {path: (mark, key) for path, (mark, key) in answers.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _write_seen_files(out: Path, seen: Mapping[str, tuple[str, str]]) -> None:
    write_atomically(out / SEEN_FILES_NAME, json.dumps(seen))


def _find_file_states(
    paths: Sequence[str], options: StoreOptions
) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Returns by path a state that changes with the file, without reading the file, "" where
    unknown; and for a URL its companion files, by one listing of each folder."""
    states, folders = dict[str, tuple[str, tuple[str, ...]]](), dict[str, dict[str, Any]]()
    for path in paths:
        if "://" not in path:
            states[path] = _find_file_state(path), ()
            continue
        import fsspec

        system, name = fsspec.core.url_to_fs(path, **options)
        folder = f"{name.rpartition('/')[0]}/"
        if folder not in folders:
            folders[folder] = {}
            # Stores that list no folder raise errors of their own kinds.
            with contextlib.suppress(Exception):
                folders[folder] = {one["name"]: one for one in system.ls(folder, detail=True)}
        there = folders[folder]
        sides = tuple(
            side
            for side in list_side_urls(name)
            if (side in there if name in there else system.exists(side))
        )
        with contextlib.suppress(OSError, NotImplementedError):
            states[path] = "", sides
            state = " ".join(str(there.get(one) or system.ukey(one)) for one in (name, *sides))
            states[path] = hashlib.sha256(state.encode()).hexdigest(), sides
    return states


def _find_file_state(path: str) -> str:
    from topdress.drivers.files.any_log import find_import_file

    try:
        status = Path(path).stat()
        side_files = (Path(path).with_suffix(".yaml"), find_import_file(Path(path)))
        return " ".join(
            map(
                str,
                (
                    status.st_size,
                    status.st_mtime_ns,
                    *(
                        one.stat().st_mtime_ns if one is not None and one.is_file() else 0
                        for one in side_files
                    ),
                ),
            )
        )
    except OSError:
        return ""

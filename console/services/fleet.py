"""Thousands of logs on a Dask cluster, each diagnosed once: what is done stays, whatever ends.

In the output folder: `logs/CHECKSUM.json` a log's record by the checksum of its bytes, `seen.json` which file had which
checksum when it was last looked at. A second run diagnoses only what is new. Records come back over the cluster and are
written here: workers need no folder in common, but the logs.
"""
from __future__ import annotations

import contextlib
import dataclasses
import json
import logging
import pkgutil
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from console.services.fleet_job import FORMAT, checksum, record
from drivers.files.atomic import write_atomically
from drivers.files.extras import install_line

LOGS, SEEN = "logs", "seen.json"
SUFFIXES = (".csv", ".parquet", ".pq")
ASIDE = (".truth.csv",)
AHEAD = 4                       # tasks in the cluster for each of its threads: few, so that cancelling is quick
MEMORY = "2GB"                  # of a local worker
CONNECT_S, JOIN_S = 10.0, 30.0  # how long a scheduler, and the first of its workers, are waited for

GONE = "the scheduler is gone: what is done is kept; the same command goes on"
LOUD = ("distributed", "tornado", "asyncio")    # loggers: they tell in traces what is told here in a line

Tell = Callable[[int, int, str], None]      # done, of how many, what


class NoDask(ValueError):
    """Dask is not installed."""


@dataclasses.dataclass(frozen=True, slots=True)
class Found:
    """Records by path, errors by path, how many were known before, and how many are the same bytes as others."""

    records: tuple[Mapping[str, Any], ...]
    broken: tuple[tuple[str, str], ...]
    known: int
    twins: int


@contextlib.contextmanager
def cluster(scheduler: str | None, workers: int) -> Iterator[Any]:
    """A Dask client: of the scheduler at an address, else of workers on this computer. Raises NoDask, OSError."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise NoDask(f"a fleet needs Dask, and it is not installed: {install_line('fleet')}") from None
    for name in logging.root.manager.loggerDict:
        if name.startswith(LOUD):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    if scheduler is not None:
        with _of(scheduler, Client) as client:
            yield client
        return
    try:
        with _deaf():
            local = LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, memory_limit=MEMORY,
                                 dashboard_address=None)
    except RuntimeError as error:
        raise OSError(f"the workers of this computer did not start: {error}") from None
    with local, Client(local, set_as_default=False) as client:
        yield client


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Processes that begin here do not hear Ctrl-C: it is this one's to end them, without a trace from each."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _of(scheduler: str, make: Callable[..., Any]) -> Iterator[Any]:
    """A client of a scheduler that is there, with workers that can do the work. Raises OSError, in one line."""
    try:
        client = make(scheduler, set_as_default=False, timeout=CONNECT_S)
    except Exception as error:      # of an address that it does not know Dask has many words
        why = (str(error).splitlines() or ["nobody answers"])[0]
        raise OSError(f"{scheduler}: no Dask scheduler: {why}") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=JOIN_S)
        except TimeoutError:
            raise OSError(f"{scheduler}: no worker in {JOIN_S:.0f} s: allowed is a scheduler with at least one "
                          f"(dask worker {scheduler})") from None
        for line in unlike(client.get_versions()):
            raise OSError(f"{scheduler}: {line}")
        for line in without_us(_formats(client)):
            raise OSError(f"{scheduler}: {line}")
        yield client


def _formats(client: Any) -> dict[str, Any]:
    """By scheduler and worker the format of records that its topdress makes; what was raised where it has none."""
    asked = (pkgutil.resolve_name, f"{record.__module__}:FORMAT")
    told = {f"worker {name}": said for name, said in client.run(*asked, on_error="return").items()}
    try:
        return {"the scheduler": client.run_on_scheduler(*asked), **told}
    except ImportError as error:
        return {"the scheduler": error, **told}


def without_us(formats: Mapping[str, Any]) -> Iterator[str]:
    """Who has no topdress, or one that makes other records, a line each."""
    for who, said in formats.items():
        if isinstance(said, BaseException):
            yield f"{who} has no topdress: allowed is the same as here on the scheduler and every worker"
        elif said != FORMAT:
            yield f"{who} has a topdress that makes records {said}: allowed {FORMAT}"


def unlike(versions: Mapping[str, Any]) -> Iterator[str]:
    """What makes a scheduler or worker unable to work with this program, a line each. versions: as Dask tells them."""
    here = versions["client"]
    others = {"the scheduler": versions["scheduler"],
              **{f"worker {name}": told for name, told in versions["workers"].items()}}
    for who, told in others.items():
        if not told:
            yield f"{who} does not tell its versions"
            continue
        for package in ("distributed", "cloudpickle"):
            if told["packages"].get(package) != here["packages"].get(package):
                yield (f"{who} has {package} {told['packages'].get(package)}, here is {here['packages'].get(package)}: "
                       "allowed is the same")
        if told["host"]["python"].split(".")[:2] != here["host"]["python"].split(".")[:2]:
            yield (f"{who} runs Python {told['host']['python']}, here is {here['host']['python']}: allowed is the same "
                   "but for its last number")


def logs_at(paths: Sequence[str], out: Path) -> list[str]:
    """Files, the logs in folders at any depth, and what stars and fsspec URLs stand for; each once, in order. Of what
    lies in `out` only what was named itself: that is refused before it is written over.

    Raises OSError for one that is not there.
    """
    found: list[str] = []
    for where in paths:
        if "://" in where:
            found += _at_url(where)
        elif Path(where).is_dir():
            found += [str(file) for file in sorted(Path(where).rglob("*")) if _is_log(file.name) and file.is_file()]
        elif any(sign in where for sign in "*?["):
            import glob
            found += sorted(file for file in glob.glob(where, recursive=True) if Path(file).is_file())
        elif Path(where).exists():
            found.append(where)
        else:
            raise FileNotFoundError(2, "no such file or folder", where)
    own, named = out.resolve(), set(paths)
    return [log for log in dict.fromkeys(found)
            if "://" in log or log in named or own not in Path(log).resolve().parents]


def _is_log(name: str) -> bool:
    return name.lower().endswith(SUFFIXES) and not name.lower().endswith(ASIDE) and not name.startswith(".")


def _at_url(where: str) -> list[str]:
    try:
        import fsspec
    except ImportError:
        raise NoDask(f"a URL needs fsspec, and it is not installed: {install_line('fleet')}") from None
    system, path = fsspec.core.url_to_fs(where)
    if any(sign in path for sign in "*?["):
        names = system.glob(path)
    else:
        names = system.find(path) if system.isdir(path) else [path]
    return [system.unstrip_protocol(name) for name in sorted(names) if _is_log(name.split("/")[-1]) or name == path]


def diagnosed(client: Any, paths: Sequence[str], machine: Mapping[str, Any], about: Mapping[str, Mapping[str, str]],
              out: Path, salt: str, tell: Tell) -> Found:
    """Every log's record. KeyboardInterrupt passes through: what is done is kept."""
    (out / LOGS).mkdir(parents=True, exist_ok=True)
    seen = _seen(out)
    marks = {path: _mark(path, salt, about.get(path, {})) for path in paths}
    keys = {path: seen[path][1] for path in paths if path in seen and seen[path][0] == marks[path] and marks[path]}
    unknown = [path for path in paths if path not in keys]
    errors: dict[str, str] = {}
    kept: dict[str, dict[str, Any]] = {}
    try:
        for number, (path, key, why) in enumerate(_worked(client, checksum, {
                path: (path, salt + json.dumps(about.get(path, {}), sort_keys=True)) for path in unknown})):
            if why:
                errors[path] = why
            else:
                keys[path] = key
                seen[path] = (marks[path], key)
            tell(number + 1, len(unknown), "looking at the files")
        first: dict[str, str] = {}
        for path, key in keys.items():
            first.setdefault(key, path)
        kept = {key: one for key in first if (one := _kept(out, key)) is not None}
        todo = {path: key for key, path in first.items() if key not in kept}
        known = len(kept)
        for number, (path, made, why) in enumerate(_worked(client, record, {
                path: (path, machine, dict(about.get(path, {}))) for path in todo})):
            if why:                             # what no worker survived is tried again the next time
                errors[path] = why
            elif (mark := _mark(path, salt, about.get(path, {}))) != marks[path]:
                errors[path] = "it was written while it was read: the same command reads it again"
                seen.pop(path, None)
            else:
                seen[path] = (mark, todo[path])
                kept[todo[path]] = made
                write_atomically(_place(out, todo[path]), json.dumps(made))
            tell(known + number + 1, len(first), "diagnosing")
    finally:
        write_atomically(out / SEEN, json.dumps(seen))
    records = [{"key": key, **kept[key]} for key in first if key in kept]
    broken = [*errors.items(), *((one["path"], one["error"]) for one in records if "error" in one)]
    return Found(tuple(one for one in records if "error" not in one), tuple(sorted(broken)), known,
                 len(keys) - len(first))


def _kept(out: Path, key: str) -> dict[str, Any] | None:
    """A record of an earlier run; None where there is none that can be read."""
    try:
        made = json.loads(_place(out, key).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return made if isinstance(made, dict) and made.get("format") == FORMAT else None


def _worked(client: Any, work: Callable[..., Any], todo: Mapping[str, tuple[Any, ...]]
            ) -> Iterator[tuple[str, Any, str]]:
    """(path, result, "") or (path, None, why), as they are done; a worker that dies has its tasks done by another."""
    from distributed import as_completed
    from distributed.comm.core import CommClosedError
    waiting = iter(todo.items())
    room = max(1, AHEAD * sum(client.nthreads().values()))
    running: dict[Any, str] = {}
    done = as_completed(loop=client.loop)

    def put() -> None:
        for path, arguments in waiting:
            future = client.submit(work, *arguments, pure=False)
            running[future] = path
            done.add(future)
            return
    for _ in range(min(room, len(todo))):
        put()
    try:
        for future in done:
            path = running.pop(future)
            if future.status == "cancelled":
                raise OSError(GONE)
            error = future.exception() if future.status == "error" else None
            result = None if error is not None else future.result()
            future.release()
            put()
            yield path, result, "" if error is None else (str(error).splitlines() or [type(error).__name__])[0]
    except (CommClosedError, CancelledError):
        raise OSError(GONE) from None
    finally:
        with contextlib.suppress(CommClosedError, CancelledError):
            client.cancel(list(running))


def _place(out: Path, key: str) -> Path:
    return out / LOGS / f"{key}.json"


def _seen(out: Path) -> dict[str, tuple[str, str]]:
    try:
        told = json.loads((out / SEEN).read_text(encoding="utf-8"))
        return {path: (mark, key) for path, (mark, key) in told.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _mark(path: str, salt: str, about: Mapping[str, str]) -> str:
    """Tells whether a file is as it was without reading it; "" where that cannot be told."""
    try:
        if "://" in path:
            import fsspec
            system, name = fsspec.core.url_to_fs(path)
            state = system.ukey(name)
        else:
            status, beside = Path(path).stat(), Path(path).with_suffix(".yaml")
            state = f"{status.st_size} {status.st_mtime_ns} {beside.stat().st_mtime_ns if beside.is_file() else 0}"
    except (OSError, NotImplementedError):
        return ""
    return f"{state} {salt} {json.dumps(dict(about), sort_keys=True)}"

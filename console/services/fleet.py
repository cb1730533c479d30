"""Thousands of logs on a Dask cluster, each diagnosed once: what is done stays, whatever ends.

In the output folder: `logs/CHECKSUM.json` a log's record by the checksum of its bytes, `seen.json` which file had which
checksum when it was last looked at. A second run diagnoses only what is new. Records come back over the cluster and are
written here: workers need no folder in common, but the logs.
"""
from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from console.services.fleet_job import checksum, record
from drivers.files.atomic import write_atomically

LOGS, SEEN = "logs", "seen.json"
SUFFIXES = (".csv", ".parquet", ".pq")
ASIDE = (".truth.csv",)
AHEAD = 4                       # tasks in the cluster for each of its threads: few, so that cancelling is quick
MEMORY = "2GB"                  # of a local worker

Tell = Callable[[int, int, str], None]      # done, of how many, what


class NoDask(ValueError):
    """Dask is not installed."""


@dataclasses.dataclass(frozen=True, slots=True)
class Found:
    """Records by path, errors by path, and how many were known before."""

    records: tuple[Mapping[str, Any], ...]
    broken: tuple[tuple[str, str], ...]
    known: int


@contextlib.contextmanager
def cluster(scheduler: str | None, workers: int) -> Iterator[Any]:
    """A Dask client: of the scheduler at an address, else of workers on this computer. Raises NoDask, OSError."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise NoDask("a fleet needs Dask, and it is not installed: pip install 'topdress[fleet]'") from None
    if scheduler is not None:
        with Client(scheduler, set_as_default=False) as client:
            yield client
        return
    try:
        local = LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, memory_limit=MEMORY,
                             dashboard_address=None)
    except RuntimeError as error:
        raise OSError(f"the workers of this computer did not start: {error}") from None
    with local, Client(local, set_as_default=False) as client:
        yield client


def logs_at(paths: Iterable[str]) -> list[str]:
    """Files, the logs in folders at any depth, and what stars and fsspec URLs stand for; each once, in order.

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
    return list(dict.fromkeys(found))


def _is_log(name: str) -> bool:
    return name.lower().endswith(SUFFIXES) and not name.lower().endswith(ASIDE) and not name.startswith(".")


def _at_url(where: str) -> list[str]:
    try:
        import fsspec
    except ImportError:
        raise NoDask("a URL needs fsspec, and it is not installed: pip install 'topdress[fleet]'") from None
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
        todo = {path: key for key, path in first.items() if not _place(out, key).exists()}
        known = len(first) - len(todo)
        for number, (path, made, why) in enumerate(_worked(client, record, {
                path: (path, machine, dict(about.get(path, {}))) for path in todo})):
            told = {"path": path, "error": why, "lost": True} if why else made
            if not told.get("lost"):            # what no worker survived is tried again the next time
                write_atomically(_place(out, todo[path]), json.dumps(told))
            else:
                errors[path] = why
            tell(known + number + 1, len(first), "diagnosing")
    finally:
        write_atomically(out / SEEN, json.dumps(seen))
    records = []
    for key in first:
        with contextlib.suppress(FileNotFoundError):
            records.append({"key": key, **json.loads(_place(out, key).read_text(encoding="utf-8"))})
    broken = [*errors.items(), *((one["path"], one["error"]) for one in records if "error" in one)]
    return Found(tuple(one for one in records if "error" not in one), tuple(sorted(broken)), known)


def _worked(client: Any, work: Callable[..., Any], todo: Mapping[str, tuple[Any, ...]]
            ) -> Iterator[tuple[str, Any, str]]:
    """(path, result, "") or (path, None, why), as they are done; a worker that dies has its tasks done by another."""
    from distributed import as_completed
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
            error = future.exception() if future.status == "error" else None
            result = None if error is not None else future.result()
            future.release()
            put()
            yield path, result, "" if error is None else (str(error).splitlines() or [type(error).__name__])[0]
    finally:
        client.cancel(list(running))


def _place(out: Path, key: str) -> Path:
    return out / LOGS / f"{key}.json"


def _seen(out: Path) -> dict[str, Any]:
    try:
        return dict(json.loads((out / SEEN).read_text(encoding="utf-8")))
    except (OSError, ValueError):
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

"""A fleet of logs: each done once, broken ones listed, a dead worker's work done again,
cancelled work gone on with."""

from __future__ import annotations

import datetime as dt
import functools
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from topdress.console.reports.fleet_page import (
    describe_costliest,
    list_service_steps,
    make_fleet_page,
)
from topdress.console.reports.number_text import format_fixed
from topdress.console.services import fleet
from topdress.console.services.fleet_job import (
    FORMAT,
    calc_checksum,
    list_side_urls,
    make_record,
    read_record,
)
from topdress.console.services.fleet_metadata import apply_list_row, match_rows
from topdress.console.services.fleet_season import make_season
from topdress.console.services.fleet_tables import TABLE_COLUMNS, write_tables
from topdress.control.diagnosis.season.effect_timelines import SeasonCause, SeasonFit
from topdress.control.diagnosis.season.log_evidence import collect_log_evidence
from topdress.control.diagnosis.season.season_cost import rank_machines_by_cost
from topdress.control.machine.machine import Machine
from topdress.drivers import day_clock
from topdress.drivers.files.log_store import write_log_store
from topdress.drivers.files.read_log import read_nonempty_log

from tests.command import topdress
from tests.waiting import wait_for

MACHINE = Machine().model_dump(mode="json")


def wheel_log(path: Path, percent: float = 0.0, seconds: float = 120.0, seed: int = 1) -> Path:
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, seconds, 0.1)
    speed = 1.3 + 0.2 * np.sin(time_s / 7.0)
    columns = {
        "time_s": time_s,
        "speed_mps": speed + 0.03 * rng.standard_normal(len(time_s)),
        "wheel_speed_mps": (1.0 + percent / 100.0) * speed
        + 0.02 * rng.standard_normal(len(time_s)),
        "applied_rate_kg_ha": np.full(len(time_s), 300.0),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".parquet":
        write_log_store(path, columns, None)
    else:
        pl.DataFrame(columns).write_csv(path)
    return path


NOW_D = 20_600.0  # a day in May 2026


class Asked:
    """In place of `record`: which logs were asked for stands in a file, for workers have
    memories of their own."""

    def __init__(self, file: Path, spoilt: str = "") -> None:
        self.file, self.spoilt = file, spoilt

    def answer(self, where: str, options: Any, machine: Any, sides: Any) -> dict[str, Any]:
        with self.file.open("a") as opened:
            opened.write(where + "\n")
        said = {"format": FORMAT, "path": where}
        return {**said, "error": "spoilt", "lasting": True} if where == self.spoilt else said

    @property
    def so_far(self) -> list[str]:
        return self.file.read_text().splitlines()


def quiet(*_: Any) -> None:
    pass


@pytest.fixture
def client() -> Any:
    distributed = pytest.importorskip("distributed", reason="the extra `fleet` is not installed")
    threads = {
        "n_workers": 1,
        "threads_per_worker": 1,
        "processes": False,
        "dashboard_address": None,
    }
    with (
        distributed.LocalCluster(**threads) as local,
        distributed.Client(local, set_as_default=False) as one,
    ):
        yield one


@pytest.fixture
def diagnosed(tmp_path: Path, client: Any) -> Any:
    """All logs of a fleet into `out` of this test, asked of what stands in the place of
    `record`."""

    def work(logs: list[str], asked: Asked, tell: Any = quiet, retry: bool = False) -> Any:
        wanted = fleet.FleetRequest(MACHINE, "s", retry=retry)
        return fleet.diagnose_fleet(client, logs, wanted, tmp_path / "out", tell, asked.answer)

    return work


@pytest.fixture
def logs(tmp_path: Path) -> list[str]:
    return [str(wheel_log(tmp_path / "in" / f"{k}.csv", seed=k)) for k in range(6)]


def test_a_record_tells_machine_time_and_sizes_with_their_errors(tmp_path: Path) -> None:
    said = apply_list_row(
        make_record(str(wheel_log(tmp_path / "seeder 7" / "a.csv", 2.0)), {}, MACHINE),
        {"operator": "Li", "time": "2026-04-01T08:00:00+08:00"},
    )
    assert (
        said["unit"] == "seeder 7" and said["shared"]["operator"] == "Li" and said["rows"] == 1200
    )
    assert said["time_d"] == pytest.approx(20544.0)
    (form,) = [one for one in said["forms"] if "speed.wheel_radius" in one["names"]]
    at = form["names"].index("speed.wheel_radius")
    size = form["right"][at] / form["normal"][at][at]
    assert size == pytest.approx(2.0, abs=4.0 / form["normal"][at][at] ** 0.5)
    assert said["percent"]["speed.wheel_radius"] == pytest.approx(2.0 / 2.0, abs=0.1)
    assert said["worked"]["applied_kg"] == 0.0 or said["worked"]["hours"] > 0.0
    json.dumps(said)


@pytest.mark.exam
def test_sums_of_forms_are_the_joint_likelihood_of_the_logs(tmp_path: Path) -> None:
    """The size by many short logs is that of their mean, with an error by the square root
    smaller."""
    sizes, errors = [], []
    for seed in range(8):
        log = read_nonempty_log(wheel_log(tmp_path / f"{seed}.csv", 1.0, seed=seed))
        form = collect_log_evidence(log.columns, Machine()).forms[0]
        at = form.names.index("speed.wheel_radius")
        sizes.append(form.right[at] / form.normal[at][at])
        errors.append(form.normal[at][at] ** -0.5)
    assert np.mean(sizes) == pytest.approx(1.0, abs=3.0 * errors[0] / 8**0.5)
    assert np.std(sizes) == pytest.approx(np.mean(errors), rel=0.7)


def test_a_log_tells_how_far_its_machines_tolerances_pull(tmp_path: Path) -> None:
    """A wheel off by its tolerance moves the log's score as said."""
    machine = Machine()
    off = [
        collect_log_evidence(
            read_nonempty_log(
                wheel_log(tmp_path / f"{k}.csv", k * machine.tolerance.wheel_percent)
            ).columns,
            machine,
        ).forms[0]
        for k in (0, 1)
    ]
    at = off[0].open.index("tolerance speed.radius_percent 0")
    moved = np.array(off[1].right) - np.array(off[0].right)
    assert moved == pytest.approx([row[at] for row in off[0].pulls], rel=0.1)


def test_a_log_counts_for_as_much_whatever_it_has_to_tell(tmp_path: Path) -> None:
    told = [
        collect_log_evidence(
            read_nonempty_log(wheel_log(tmp_path / f"{k}.csv", percent)).columns, Machine()
        ).forms[0]
        for k, percent in enumerate((0.0, 0.5))
    ]
    at = told[0].names.index("speed.wheel_radius")
    assert told[1].normal[at][at] == pytest.approx(told[0].normal[at][at], rel=0.1)


@pytest.mark.parametrize(
    "content", ["", "time_s,speed\n1,2\n", "a,b\nc,d\n", "time_s,speed_mps\n0,1\n0.1,"]
)
def test_a_broken_log_is_a_record_with_one_line(tmp_path: Path, content: str) -> None:
    path = tmp_path / "broken.csv"
    path.write_text(content)
    said = make_record(str(path), {}, MACHINE)
    assert said["error"] and "\n" not in said["error"]
    assert make_record(str(tmp_path / "not-there.csv"), {}, MACHINE)["error"]


@pytest.mark.parametrize(
    ("begin", "what"),
    [(b"PK\x03\x04", "a zip"), (b"PAR1", "a Parquet file"), (b"\x1f\x8b", "a gzip file")],
)
def test_what_has_anothers_suffix_is_said(tmp_path: Path, begin: bytes, what: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(begin + bytes(range(256)))
    said = make_record(str(path), {}, MACHINE)["error"]
    assert said.startswith(f"{path}: {what}") and said.isprintable()


def test_the_checksum_is_of_log_sidecar_and_salt(tmp_path: Path) -> None:
    path = wheel_log(tmp_path / "a.csv")
    first = calc_checksum(str(path), {}, "1")
    assert calc_checksum(str(path), {}, "2") != first
    (tmp_path / "b.csv").write_bytes(path.read_bytes())
    assert calc_checksum(str(tmp_path / "b.csv"), {}, "1") == first
    path.with_suffix(".yaml").write_text("operator: Li\n")
    assert calc_checksum(str(path), {}, "1") != first


def test_the_sidecar_of_a_url() -> None:
    assert list_side_urls("http://host:8000/m.1/a b.csv") == tuple(
        f"http://host:8000/m.1/{name}.yaml" for name in ("a b", "a b.import", "import")
    )
    assert list_side_urls("/bucket/a")[0] == "/bucket/a.yaml"
    assert list_side_urls("a.b.parquet") == ("a.b.yaml", "a.b.import.yaml", "import.yaml")


@pytest.mark.exam
def test_logs_in_a_store_are_seen_by_one_listing_of_a_folder(
    tmp_path: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else each log is asked after several times, in turn; and a sidecar that changed there
    went unseen."""
    fsspec = pytest.importorskip("fsspec", reason="the extra `fleet` is not installed")
    store, asked = type(fsspec.filesystem("memory")), list[str]()
    for name in ("exists", "ls", "get_file", "ukey"):

        def counted(its: Any, real: Any, *words: Any, **more: Any) -> Any:
            asked.append(real.__name__)
            return real(its, *words, **more)

        monkeypatch.setattr(store, name, functools.partialmethod(counted, getattr(store, name)))
    for k in range(3):
        store().pipe(
            f"/season/m{k // 2}/{k}.csv",
            wheel_log(tmp_path / f"{k}.csv", seconds=30.0, seed=k).read_bytes(),
        )
    store().pipe("/season/m1/2.yaml", b"format: topdress-run-log/1\noperator: Li\n")

    def operators() -> tuple[list[str], int, float]:
        asked.clear()
        found = fleet.diagnose_fleet(
            client,
            fleet.find_logs(["memory://season"], tmp_path / "out"),
            fleet.FleetRequest(MACHINE, "s"),
            tmp_path / "out",
            quiet,
        )
        assert not found.broken
        return (
            [one["shared"]["operator"] for one in found.records],
            found.known,
            found.records[0]["time_d"],
        )

    assert operators()[:2] == (["", "", "Li"], 0)
    assert (
        Counter(asked)["get_file"] == 2 * 4
        and asked.count("ls") <= 6
        and not {"exists", "ukey"} & {*asked}
    )
    store().pipe("/season/m1/2.yaml", b"format: topdress-run-log/1\noperator: Sun\n")
    store.store["/season/m0/0.csv"].modified = dt.datetime(2026, 4, 1, tzinfo=dt.UTC)
    assert operators()[:2] == (["", "", "Sun"], 2)
    shutil.rmtree(tmp_path / "out")
    # one that shows no folders
    monkeypatch.setattr(store, "ls", lambda *_words, **_more: [])
    found = fleet.diagnose_fleet(
        client,
        ["memory://season/m0/0.csv", "memory://season/m1/2.csv"],
        fleet.FleetRequest(MACHINE, "s"),
        tmp_path / "out",
        quiet,
    )
    assert (
        found.records[1]["shared"]["operator"] == "Sun" and found.records[0]["time_d"] == 20_544.0
    )


def test_which_logs_are_meant(tmp_path: Path) -> None:
    for name in ("x/a.csv", "x/y/b.parquet", "x/c.truth.csv", "x/d.txt", "x/.e.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    meant = [str(tmp_path / "x"), str(tmp_path / "x" / "a.csv"), str(tmp_path / "x" / "*.txt")]
    found = fleet.find_logs(meant, tmp_path / "out")
    assert [Path(one).name for one in found] == ["a.csv", "b.parquet", "d.txt"]
    # an output
    assert [Path(one).name for one in fleet.find_logs(meant, tmp_path / "x" / "y")] == [
        "a.csv",
        "d.txt",
    ]
    with pytest.raises(OSError, match="no such file"):
        fleet.find_logs([str(tmp_path / "nowhere")], tmp_path / "out")


def test_each_log_is_diagnosed_once_and_broken_ones_are_listed(
    tmp_path: Path, logs: list[str], diagnosed: Any
) -> None:
    logs = [*logs[:3], str(tmp_path / "in" / "twin.csv")]
    Path(logs[3]).write_bytes(Path(logs[0]).read_bytes())
    asked = Asked(tmp_path / "asked", logs[2])
    found = diagnosed(logs, asked)
    assert sorted(asked.so_far) == sorted(logs[:3]) and found.known == 0
    assert len(found.records) == 2 and found.broken == ((logs[2], "spoilt"),) and found.twins == 1
    again = diagnosed(logs, asked)
    assert len(asked.so_far) == 3 and again.known == 3 and again.broken == found.broken
    wheel_log(Path(logs[1]), seed=9)
    diagnosed(logs, asked)
    assert asked.so_far[3:] == [logs[1]]


def test_few_tasks_wait_in_the_cluster(client: Any) -> None:
    """Else a cancel waits for all logs; and each task that is done brings the next one, without
    asking the scheduler who is there: that took longer than the task."""
    asked, submit, nthreads, here = [], client.submit, client.nthreads, threading.get_ident()
    work, ahead, who = (
        fleet._FleetTasks(client, list(nthreads())),
        fleet.TASKS_PER_THREAD * sum(nthreads().values()),
        [],
    )
    client.submit = lambda *words, **more: asked.append(words) or submit(*words, **more)
    client.nthreads = lambda: who.append(threading.get_ident()) or nthreads()
    done = work.run_once(len, {str(k): ("x" * k,) for k in range(20)})
    assert ahead < 20
    seen = []
    for number, (path, result, error) in enumerate(done, 1):
        seen.append((int(path), result, error))
        assert len(asked) == min(20, ahead + number)
    assert sorted(seen) == [(k, k, "") for k in range(20)] and here not in who
    asked.clear()
    several = {str(k): (str(k) if k % 9 else "none",) for k in range(60)}
    said = {
        int(k): (result, why.split(":")[0])
        for k, result, why in work.run_once(int, several, fleet.CHECKSUMS_PER_TASK)
    }
    assert len(asked) == -(-60 // min(fleet.CHECKSUMS_PER_TASK, 60 // ahead))
    assert said == {
        k: (k, "") if k % 9 else (None, "invalid literal for int() with base 10") for k in range(60)
    }


def test_what_is_done_before_a_cancel_is_kept(
    tmp_path: Path, logs: list[str], diagnosed: Any
) -> None:
    def tell(done: int, of: int, what: str) -> None:
        if what == "diagnosing" and done == 2:
            raise KeyboardInterrupt

    asked = Asked(tmp_path / "asked")
    with pytest.raises(KeyboardInterrupt):
        diagnosed(logs, asked, tell=tell)
    kept = [
        json.loads(one.read_text())["path"] for one in (tmp_path / "out" / "logs").glob("*.json")
    ]
    assert len(kept) == 2
    found = diagnosed(logs, asked)
    assert found.known == 2 and len(found.records) == 6
    # others may have been begun when it was cancelled
    assert all(asked.so_far.count(log) == 1 for log in kept)


def test_a_record_that_cannot_be_read_is_made_again(
    tmp_path: Path, logs: list[str], diagnosed: Any
) -> None:
    asked = Asked(tmp_path / "asked")
    diagnosed(logs[:3], asked)
    first, second, _ = sorted((tmp_path / "out" / "logs").glob("*.json"))
    first.write_text("")
    second.write_text('{"format": "of long ago"}')
    (tmp_path / "out" / "seen.json").write_text('{"a": 3}')
    found = diagnosed(logs[:3], asked)
    assert len(asked.so_far) == 5 and len(found.records) == 3 and found.known == 1


class Written(Asked):
    """A log that another program still writes."""

    def answer(self, where: str, options: Any, machine: Any, sides: Any) -> dict[str, Any]:
        if where == self.spoilt:
            with Path(where).open("a") as opened:
                opened.write("1000.0,1.0,1.0,300.0\n")
        return super().answer(where + "", options, machine, sides) | {"path": where}


def test_a_log_that_is_written_while_it_is_read_is_read_again(
    tmp_path: Path, logs: list[str], diagnosed: Any
) -> None:
    found = diagnosed(logs[:2], Written(tmp_path / "asked", logs[0]))
    assert (
        len(found.records) == 1
        and found.broken[0][0] == logs[0]
        and "written while" in found.broken[0][1]
    )
    asked = Asked(tmp_path / "again")
    assert len(diagnosed(logs[:2], asked).records) == 2
    assert asked.so_far == [logs[0]]


def test_a_full_disk_ends_it_and_keeps_what_is_done(
    tmp_path: Path, logs: list[str], diagnosed: Any
) -> None:
    write, room = fleet.write_atomically, [3]  # what is seen, and two records

    def written(path: Path, content: str, kept: bool = True) -> None:
        room[0] -= 1
        if room[0] < 0:
            raise OSError(28, "No space left on device", str(path))
        write(path, content, kept)

    with pytest.MonkeyPatch.context() as full:
        full.setattr(fleet, "write_atomically", written)
        with pytest.raises(OSError, match="No space left"):
            diagnosed(logs[:4], Asked(tmp_path / "asked"))
    found = diagnosed(logs[:4], Asked(tmp_path / "asked"))
    assert found.known == 2 and len(found.records) == 4


def test_a_scheduler_that_is_not_there_is_one_line() -> None:
    pytest.importorskip("distributed", reason="the extra `fleet` is not installed")
    for address in ("tcp://127.0.0.1:9", "nowhere", "http://127.0.0.1:9"):
        with pytest.raises(OSError) as raised, fleet.open_cluster(address, 1, connect_s=0.5):
            pass
        assert str(raised.value).startswith(f"{address}: no Dask scheduler: ") and "\n" not in str(
            raised.value
        )


def test_a_cluster_of_other_versions_is_said() -> None:
    def told(**packages: str) -> dict[str, Any]:
        return {
            "host": {"python": packages.pop("python", "3.11.7.final.0")},
            "packages": {"distributed": "2026.8.0", "cloudpickle": "3.1.2", **packages},
        }

    same = {
        "client": told(),
        "scheduler": told(),
        "workers": {"tcp://a": told(python="3.11.9.final.0")},
    }
    assert not list(fleet.list_version_clashes(same))
    other = {
        **same,
        "scheduler": told(distributed="2024.1.0"),
        "workers": {"tcp://a": told(python="3.12.1.final.0")},
    }
    scheduler, worker = fleet.list_version_clashes(other)
    assert "the scheduler has distributed 2024.1.0, here is 2026.8.0" in scheduler
    assert "worker tcp://a runs Python 3.12.1" in worker


def test_a_worker_without_topdress_is_said() -> None:
    told = {
        "the scheduler": ModuleNotFoundError("topdress"),
        "worker a": FORMAT,
        "worker b": "topdress-fleet-log/1",
    }
    scheduler, worker = fleet.list_without_topdress(told)
    assert (
        scheduler.startswith("the scheduler has no topdress")
        and "worker b has a topdress that makes" in worker
    )


def test_a_cluster_that_is_as_here_is_used(client: Any) -> None:
    with fleet.open_cluster(client.scheduler.address, 1) as other:
        assert other.nthreads() == client.nthreads()


def test_a_worker_that_ends_is_noted() -> None:
    class Client:
        workers = {"tcp://a": 1, "tcp://b": 1}

        def nthreads(self) -> dict[str, int]:
            return dict(self.workers)

    client, over = Client(), threading.Event()
    work = fleet._FleetTasks(client, list(client.workers), look_s=0.01)
    thread = threading.Thread(target=work._watch_workers, args=({}, over, threading.Event()))
    client.workers = {"tcp://a": 1, "tcp://c": 1}
    thread.start()
    wait_for(lambda: work.gone)
    over.set()
    thread.join()
    assert work.gone == ["tcp://b"]


def test_workers_of_this_computer_keep_the_memory_of_arrays_as_any_process_does() -> None:
    """Dask's own setting has each larger array mapped anew: a diagnosis then takes twice as
    long."""
    pytest.importorskip("distributed", reason="the extra `fleet` is not installed")
    name = "MALLOC_TRIM_THRESHOLD_"
    outside = os.environ.get(name)  # Dask sets it here too
    with fleet.open_cluster(None, 1) as client:
        assert list(client.run(os.getenv, name).values()) == [outside]


STRANGER = """
import logging, os, sys
logging.disable(50)
from distributed import Client, Security
own = Security.temporary()
for door in sys.argv[1:]:
    for address, keys in (door.replace("tls://", "tcp://"), None), (door, None), (door, own):
        try:
            with Client(address, security=keys, set_as_default=False, timeout=4) as client:
                print("ran as", client.run_on_scheduler(os.getpid), address)
        except (OSError, TypeError) as error:
            print("refused", type(error).__name__, address)
"""


@pytest.mark.exam
def test_nobody_else_on_this_computer_reaches_the_workers() -> None:
    """Who reaches a Dask scheduler, or one of its workers, runs code as its user: any program
    on loopback did."""
    pytest.importorskip("distributed", reason="the extra `fleet` is not installed")
    with fleet.open_cluster(None, 1) as client:
        assert client.submit(sum, [1, 2]).result() == 3
        doors = [client.scheduler.address, *client.nthreads()]
        rooms = {
            Path(said)
            for said in client.run(lambda dask_worker: dask_worker.local_directory).values()
        }
        assert all(door.startswith("tls://127.0.0.1:") for door in doors)
        said = subprocess.run(
            [sys.executable, "-c", STRANGER, *doors], capture_output=True, text=True, timeout=120.0
        ).stdout.splitlines()
        assert len(said) == 3 * len(doors) and all(line.startswith("refused") for line in said), (
            said
        )
        if os.name == "posix":
            assert all(
                any(
                    parent.stat().st_mode & 0o077 == 0 and parent.stat().st_uid == os.getuid()
                    for parent in room.parents
                )
                for room in rooms
            )


def bare(path: str, unit: str, time_d: float, model: str = "one", **shared: str) -> dict[str, Any]:
    return {
        "key": path,
        "path": path,
        "unit": unit,
        "time_d": time_d,
        "time_from": "sidecar",
        "model": model,
        "shared": shared,
        "forms": [],
        "units": {},
        "percent": {},
        "worked": {
            "hours": 1.0,
            "applied_kg": 10.0,
            "area_ha": 1.0,
            "low_minutes": 0.0,
            "refills": 0,
        },
    }


def test_names_that_differ_in_capitals_or_blanks_are_one() -> None:
    logs = [
        bare("a", "Seeder 7", 20_500.0, operator="Li, Ming"),
        bare("b", "seeder  7 ", 20_501.0, operator="王强"),
        bare("c", "Seeder 7", 20_502.0, operator="li, ming"),
        bare("d", "Seeder 8", 20_502.0),
    ]
    found = make_season(logs, (), NOW_D)
    assert {one.machine: one.logs for one in found.machines} == {"Seeder 7": 3, "Seeder 8": 1}
    assert [one.shared.get("operator") for one in found.logs] == [
        "Li, Ming",
        "王强",
        "Li, Ming",
        None,
    ]


def test_logs_of_two_models_are_two_machines() -> None:
    logs = [
        bare("a", "s", 20_500.0),
        bare("b", "s", 20_501.0, model="two"),
        bare("c", "t", 20_501.0),
    ]
    found = make_season(logs, (), NOW_D)
    assert sorted(one.machine for one in found.machines) == ["s (one)", "s (two)", "t"]


@pytest.mark.parametrize("time_d", [0.001, 40_180.0, -1e12, 1e12])
def test_a_log_whose_clock_was_wrong_is_said_and_left_out(time_d: float) -> None:
    found = make_season([bare("a", "s", 20_500.0), bare("b", "s", time_d)], (), NOW_D)
    assert found.machines[0].logs == 1 and [one.path for one in found.aside] == ["b"]
    page = make_fleet_page(
        found.machines,
        SeasonFit(),
        low=[],
        units={},
        broken=(),
        price=None,
        currency="CNY",
        software="t",
        aside=found.aside,
        by_file_date=3,
    )
    assert "b: its clock said" in page and "3 logs tell no time" in page


def records(tmp_path: Path) -> list[dict[str, Any]]:
    made = []
    for machine, percent in (("one", 3.0), ("two", 0.0)):
        for day in range(4):
            path = wheel_log(tmp_path / machine / f"{day}.parquet", percent, 60.0, seed=day)
            said = apply_list_row(
                make_record(str(path), {}, MACHINE), {"time": f"2026-04-0{day + 1}"}
            )
            made.append({"key": f"{machine}{day}", **read_record(json.dumps(said))})
    return made


def test_page_and_tables(tmp_path: Path) -> None:
    made = records(tmp_path)
    assert not [one["error"] for one in made if "error" in one]
    whole = make_season(made, [("c.csv", "spoilt <b>")], NOW_D)
    worst = whole.machines[0]
    (course,) = (cost.cause for cost in worst.costs)
    assert worst.machine == course.level == "one" and course.effect.startswith("speed.wheel_")
    assert course.size == pytest.approx(3.0, abs=0.3)
    assert not whole.machines[1].costs
    write_tables(tmp_path, whole, made)
    assert pl.read_parquet(tmp_path / "courses.parquet").height == 4
    assert (
        pl.read_parquet(tmp_path / "logs.parquet")["machine"].to_list() == ["one"] * 4 + ["two"] * 4
    )
    for name, columns in TABLE_COLUMNS.items():
        assert pl.read_parquet(tmp_path / f"{name}.parquet").columns == list(columns)
    # an empty season has the same columns
    write_tables(tmp_path, make_season([], (), NOW_D), [])
    for name, columns in TABLE_COLUMNS.items():
        assert pl.read_parquet(tmp_path / f"{name}.parquet").columns == list(columns)
    product = SeasonCause("product", "compound", "speed.wheel_radius", 5.0, 0.1, 1.0, 4)
    told = [
        one._replace(shared={"product": "compound"}, worked=one.worked._replace(applied_kg=10.0))
        for one in whole.logs
        if one.machine == "two"
    ]
    (costs,) = rank_machines_by_cost(told, SeasonFit((), (product,)))
    assert costs.wrong_kg == pytest.approx(costs.costs[0].kg) and costs.wrong_kg > 0.0
    assert list_service_steps([costs])[0].startswith("product compound: ") and describe_costliest(
        costs
    ).startswith("product compound: ")
    page = make_fleet_page(
        whole.machines,
        whole.fit,
        low=whole.low,
        units=whole.units,
        broken=whole.broken,
        price=2.5,
        currency="CNY",
        software="t",
    )
    assert (
        page.index(">one<") < page.index(">two<") and "<svg" in page and "spoilt &lt;b&gt;" in page
    )
    assert "money, CNY" in page


def told_season() -> list[dict[str, Any]]:
    """Four machines, 30 days: m1 wears to -7 % of flow, m2's gate is put right after day 17,
    compound flows 5 % more."""
    rng, names = np.random.default_rng(5), ("flow.gain", "scale.gain", "gate.home_error")
    normal = np.array([[40.0, 39.98, 0.0], [39.98, 40.0, 0.0], [0.0, 0.0, 900.0]])
    made = list[dict[str, Any]]()
    for day in range(30):
        for number in range(1, 5):
            product = "compound" if (day // 3 + number) % 3 == 0 else "urea"
            sizes = np.array(
                [
                    5.0 * (product == "compound") - 7.0 / 29.0 * day * (number == 1),
                    0.0,
                    0.6 * (number == 2 and day < 18),
                ]
            )
            right = normal @ sizes + np.linalg.cholesky(normal) @ rng.normal(size=3)
            form = {
                "names": list(names),
                "normal": normal.tolist(),
                "right": right.tolist(),
                "open": [],
                "pulls": [],
            }
            made.append(
                bare(
                    f"m{number}/{day}",
                    f"m{number}",
                    20_500.0 + day,
                    product=product,
                    operator=("Li", "Sun", "Wang")[(day // 2 + number) % 3],
                    field=f"f{day // 10}",
                )
                | {
                    "forms": [read_record(json.dumps(form))],
                    "rows": 1200,
                    "units": dict(zip(names, ("%", "%", "mm"), strict=True)),
                    "verdict": "",
                    "causes": [],
                    "percent": {"flow.gain": 1.0, "gate.home_error": 2.0},
                }
            )
    return made


def test_every_number_of_the_owners_page_is_found_again_in_the_tables(tmp_path: Path) -> None:
    """Chart, sentence, kilograms, advice and tables say one thing, of a worn machine, a product
    and a repaired gate."""
    made = told_season()
    whole = make_season(made, [], NOW_D)
    write_tables(tmp_path, whole, made)
    tables = {
        name: pl.read_parquet(tmp_path / f"{name}.parquet").to_dicts() for name in TABLE_COLUMNS
    }
    page = make_fleet_page(
        whole.machines,
        whole.fit,
        low=whole.low,
        units=whole.units,
        broken=(),
        price=None,
        currency="CNY",
        software="t",
    )
    known = set[str]()
    sums = [
        {
            name: sum(one[name] for one in rows)
            for name in rows[0]
            if isinstance(rows[0][name], float | int)
        }
        for rows in (
            tables["machines"],
            *(
                [one for one in tables["costs"] if (one["level"], one["effect"]) == key]
                for key in {(one["level"], one["effect"]) for one in tables["costs"]}
            ),
        )
    ]
    for value in (
        value for rows in (*tables.values(), sums) for row in rows for value in row.values()
    ):
        if isinstance(value, float | int):
            known |= {
                f"{each:{sign}.{digits}f}"
                for each in (value, abs(value), 100.0 * value)
                for digits in range(4)
                for sign in ("", "+z")
            } | {f"{abs(value):.2g}"}
            known |= {
                format_fixed(each, digits) for each in (value, 100.0 * value) for digits in range(3)
            }
        elif value is not None:
            known.add(str(value))
    known |= {
        day_clock.convert_to_utc(one["time_d"] * 86_400.0).date().isoformat()
        for one in tables["changes"]
    }
    # "90 % interval"; what was read
    known |= {"90", str(len(made)), str(len(tables["machines"]))}
    text = re.sub(r"<(svg|style|head).*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL)
    text = re.sub(r"\bm[1-4]\b|\bf[0-2]\b|\bt\b", " ", text)
    said = re.findall(
        r"\d{4}-\d\d-\d\d|(?<![\w.+-])[+-]?\d+(?:\.\d+)?(?![\w.])", text.replace("+-", " ")
    )
    assert len(said) > 60 and not [one for one in said if one not in known], [
        one for one in said if one not in known
    ]
    by_machine = {one["machine"]: one for one in tables["machines"]}
    assert by_machine["m1"]["now_percent"] < -3.0 and by_machine["m1"]["now_most"] == pytest.approx(
        -7.0, abs=0.8
    )
    assert by_machine["m1"]["wrong_kg"] > by_machine["m1"]["least_kg"]
    (gate,) = [
        one for one in tables["costs"] if one["machine"] == "m2" and one["factor"] == "machine"
    ]
    # 0.6 mm is 1.2 % of the dose
    assert gate["kg"] == pytest.approx(18 * 10.0 * 0.012, rel=0.05)
    assert (
        f"{gate['kg']:.1f} kg spread wrongly; +0.00 mm" in text
        and "a day" in text
        and " .;" not in text
    )
    # nothing is not less than nothing
    assert "-0.0" not in re.sub(r"-0\.0*[1-9]", "", text)
    assert "Logs without a time" not in text
    advice = list_service_steps(whole.machines)
    assert any(one.startswith("product compound: The machine spreads 5 %") for one in advice)
    assert any(one.startswith("m1: ") for one in advice) and not any(
        one.startswith("m2: ") for one in advice
    )
    (repaired,) = [one for one in tables["changes"] if one["machine"] == "m2"]
    assert repaired["repair"] > 0.95 and repaired["time_d"] == 20_517.5
    # what is surely there is reported, and all else is not
    for one in tables["levels"]:
        key = one["factor"], one["level"], one["effect"]
        assert (one["probability"] > 0.05) == any(
            key == (each["factor"], each["level"], each["effect"])
            or key == (each["or_factor"], each["or_level"], each["or_effect"])
            for each in tables["alternatives"]
        ), one


def test_the_command_says_what_it_cannot_use(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    told = topdress("fleet", tmp_path / "empty", "--out", tmp_path / "out")
    assert told.exit_code != 0 and "no logs there" in told.output
    wheel_log(tmp_path / "in" / "a.csv")
    table = tmp_path / "about.csv"
    table.write_text("log,driver\na.csv,Li\n")
    told = topdress("fleet", tmp_path / "in", "--out", tmp_path / "o", "--about", table)
    assert told.exit_code != 0 and "column driver" in told.output


@pytest.mark.parametrize(
    ("said", "log"),
    [
        ("/data/m1/a.csv", "/data/m1/a.csv"),
        ("m1/a.csv", "/data/m1/a.csv"),
        ("m1\\a.csv", "/data/m1/a.csv"),
        ("./m2/a.csv", "/data/m2/a.csv"),
        ("b.csv", "/data/m2/b.csv"),
        ("C:\\logs\\here\\c.csv", "here/c.csv"),
        ("a.csv", "2 logs end so"),
        ("1/a.csv", "no such log"),
        ("m9/b.csv", "no such log"),
        ("csv", "no such log"),
    ],
)
def test_a_row_is_of_the_one_log_whose_path_ends_so(said: str, log: str) -> None:
    logs = ["/data/m1/a.csv", "/data/m2/a.csv", "/data/m2/b.csv", "here/c.csv"]
    found = match_rows([{"log": said, "operator": "Li"}], logs)
    assert [*found.of, *found.unused] == ([log] if log in logs else [f"row 1: {said}: {log}"])
    assert found.silent == (3 if log in logs else 4)
    twice = match_rows([{"log": logs[0]}, {"log": "m1/a.csv"}], logs)
    assert twice.unused == ("row 2: m1/a.csv: its log has a row already",)


@pytest.mark.exam
def test_about_is_never_ignored_and_a_changed_word_diagnoses_nothing_again(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra `fleet` is not installed")
    for name in ("m1/a", "m2/a"):
        wheel_log(tmp_path / "in" / f"{name}.csv", seconds=30.0, seed=len(name))
        wheel_log(
            tmp_path / "in" / f"{name}b.csv", seconds=30.0, seed=len(name) + 7 + (name > "m2")
        )
    table = tmp_path / "about.csv"

    def said(*rows: str) -> Any:
        table.write_text("\n".join(("log,operator,time", *rows)) + "\n")
        return topdress(
            "fleet",
            tmp_path / "in",
            "--out",
            tmp_path / "out",
            "--about",
            table,
            "--workers",
            "1",
            "--force",
        )

    none = said("m3/a.csv,Li,", "a.csv,Wang,")
    assert (
        none.exit_code != 0
        and "no row is of a log" in none.output
        and not (tmp_path / "out").exists()
    )
    assert (
        "row 1: m3/a.csv: no such log" in none.output
        and "row 2: a.csv: 2 logs end so" in none.output
    )
    assert said("m1/a.csv,Li,soon").exit_code != 0
    first = said("m1/a.csv,Li,2026-04-01", "m3/a.csv,Wang,")
    assert (
        first.exit_code == 0
        and "1 of 4 logs have a row, 3 have none; 1 rows are of no log" in first.output
    )
    second = said("m1/a.csv,Sun,2026-04-02")
    assert "(4 before)" in second.output or "(3 before)" in second.output
    logs = {
        Path(one["path"]).parent.name + Path(one["path"]).stem: one
        for one in pl.read_parquet(tmp_path / "out" / "logs.parquet").to_dicts()
    }
    assert logs["m1a"]["operator"] == "Sun" and logs["m1a"]["time_d"] == 20_545.0


@pytest.fixture(scope="module")
def two_workers() -> Any:
    distributed = pytest.importorskip("distributed", reason="the extra `fleet` is not installed")
    threads = {
        "n_workers": 2,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": None,
    }
    with (
        distributed.LocalCluster(**threads) as local,
        distributed.Client(local, set_as_default=False) as one,
    ):
        one.wait_for_workers(2)
        yield one


def hidden(folder: str) -> None:
    """Makes the process that runs it blind for a folder, as a computer that has not mounted it."""
    import sys

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and str(arguments[0]).startswith(folder):
            raise FileNotFoundError(2, "No such file or directory", str(arguments[0]))

    sys.addaudithook(refuse)


@pytest.mark.exam
def test_workers_in_other_folders_find_logs_by_relative_paths(
    tmp_path: Path, two_workers: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    logs = [str(wheel_log(Path("in") / f"{k}.csv", seconds=30.0, seed=k)) for k in range(3)]
    two_workers.run(os.chdir, "/")
    found = fleet.diagnose_fleet(
        two_workers, logs, fleet.FleetRequest(MACHINE, "s"), tmp_path / "out", quiet
    )
    assert sorted(one["path"] for one in found.records) == logs and found.twins == 0


@pytest.mark.exam
def test_a_worker_that_does_not_see_the_logs_is_left_out_and_said(
    tmp_path: Path, two_workers: Any
) -> None:
    logs = [str(wheel_log(tmp_path / "in" / f"{k}.csv", seconds=30.0, seed=k)) for k in range(4)]
    who = sorted(two_workers.nthreads())[0]
    two_workers.run(hidden, str(tmp_path / "in"), workers=[who])
    found = fleet.diagnose_fleet(
        two_workers, logs, fleet.FleetRequest(MACHINE, "s"), tmp_path / "out", quiet
    )
    assert len(found.records) == 4 and not found.broken and found.twins == 0
    assert len(found.blind) == 1 and who in found.blind[0] and "No such file" in found.blind[0]
    two_workers.run(hidden, str(tmp_path / "in"))
    with pytest.raises(OSError, match="no worker sees the logs"):
        fleet.diagnose_fleet(
            two_workers, logs, fleet.FleetRequest(MACHINE, "other"), tmp_path / "out", quiet
        )


class AtFault(Asked):
    """A worker without memory, or whose disk came off while it read."""

    def answer(self, where: str, options: Any, machine: Any, sides: Any) -> dict[str, Any]:
        said = super().answer(where, options, machine, sides)
        return (
            {**said, "error": "Input/output error", "lasting": False}
            if where == self.spoilt
            else said
        )


def test_a_workers_fault_is_never_kept_and_a_logs_own_is_tried_again_when_asked(
    tmp_path: Path, logs: list[str], diagnosed: Any
) -> None:
    fault, spoilt, whole = (
        AtFault(tmp_path / "asked", logs[0]),
        Asked(tmp_path / "again", logs[0]),
        Asked(tmp_path / "retried"),
    )
    found = diagnosed(logs[:3], fault)
    assert found.broken == ((logs[0], "Input/output error"),) and fault.so_far.count(logs[0]) == 2
    assert diagnosed(logs[:3], spoilt).broken == ((logs[0], "spoilt"),)
    diagnosed(logs[:3], spoilt)
    assert spoilt.so_far == [logs[0]]  # of itself, and then no more
    assert len(diagnosed(logs[:3], whole, retry=True).records) == 3
    assert whole.so_far == [logs[0]]


def test_a_log_that_is_not_there_is_the_workers_fault_and_one_that_is_spoilt_its_own(
    tmp_path: Path,
) -> None:
    (tmp_path / "empty.csv").write_text("")
    assert make_record(str(tmp_path / "empty.csv"), {}, MACHINE)["lasting"]
    assert not make_record(str(tmp_path / "gone.csv"), {}, MACHINE)["lasting"]
    with pytest.raises(FileNotFoundError):
        calc_checksum(str(tmp_path / "gone.csv"), {}, "s")


def test_the_import_file_beside_a_log_or_of_its_folder_says_what_its_columns_mean(
    tmp_path: Path,
) -> None:
    rows = "".join(
        f"{0.5 * k:.1f};{60 + k % 7};{60 + k % 7 + 0.1 * (k % 3):.1f}\n" for k in range(600)
    )
    (tmp_path / "a.csv").write_text("t;S;I\n" + rows)
    said = (
        "format: topdress-import/1\ntime: {column: t, counts: s}\ncolumns:\n"
        "  shaft_rpm_cmd: {from: S, unit: 1/min}\n  shaft_rpm: {from: I, unit: 1/min}\n"
    )
    assert "error" in make_record(str(tmp_path / "a.csv"), {}, MACHINE)
    before = calc_checksum(str(tmp_path / "a.csv"), {}, "s")
    for place in ("a.import.yaml", "import.yaml"):
        (tmp_path / place).write_text(said)
        found = make_record(str(tmp_path / "a.csv"), {}, MACHINE)
        assert found.get("rows") == 600, found
        assert calc_checksum(str(tmp_path / "a.csv"), {}, "s") != before
        (tmp_path / place).unlink()


@pytest.mark.exam
def test_where_nothing_was_diagnosed_the_command_fails(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra `fleet` is not installed")
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.csv").write_text("a,b\nc,d\n")
    done = topdress("fleet", tmp_path / "in", "--out", tmp_path / "out", "--workers", "1")
    assert done.exit_code != 0 and "no log was diagnosed" in done.output


def test_a_run_as_text_and_as_parquet_is_one_log(tmp_path: Path, client: Any) -> None:
    logs = [str(wheel_log(tmp_path / "in" / name, seconds=30.0)) for name in ("a.csv", "a.parquet")]
    logs.append(str(wheel_log(tmp_path / "in" / "b.csv", seconds=30.0, seed=2)))
    found = fleet.diagnose_fleet(
        client, logs, fleet.FleetRequest(MACHINE, "s"), tmp_path / "out", quiet
    )
    assert len(found.records) == 2 and found.twins == 1 and not found.broken


def test_a_log_of_six_seconds_is_no_log(tmp_path: Path) -> None:
    said = make_record(str(wheel_log(tmp_path / "a.csv", seconds=6.0)), {}, MACHINE)
    assert said["error"].endswith("6 s long: allowed is a log of 20 s and more") and said["lasting"]


def test_progress_without_a_terminal_is_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str],
) -> None:
    from topdress.console.cli.fleet import _make_progress

    now = [0.0]
    tell = _make_progress(lambda: now[0])
    for done in range(1, 101):
        now[0] += 1.0
        tell(done, 100, "diagnosing")
    assert capsys.readouterr().err.splitlines() == [f"{k} of 100 diagnosing" for k in (30, 60, 90)]


@pytest.mark.parametrize(
    ("effect", "size", "language", "said"),
    [
        (
            "gate.home_error",
            -1.04,
            "en",
            "The gate opens 1 mm less than commanded. Home the gate again; check the",
        ),
        (
            "gate.home_error",
            1.04,
            "en",
            "The gate opens 1 mm more than commanded. Home the gate again; check the",
        ),
        (
            "flow.gain#2",
            -5.0,
            "en",
            "The machine spreads 5 % less than it reckons. Do a catch test with this product.",
        ),
        ("gate.home_error", -1.04, "zh", "闸门开度比指令小 1 mm。"),
    ],
)
def test_the_owner_reads_what_the_machine_does_and_what_to_do(effect, size, language, said):
    from topdress.console.locale import use_language
    from topdress.console.reports.fleet_page import describe_for_owner

    use_language(language)
    try:
        assert describe_for_owner(effect, size).startswith(said)
    finally:
        use_language("en")


@pytest.mark.exam
def test_where_no_worker_is_left_it_ends_in_one_line():
    """Killed, or a node that went: its tasks would wait for another worker without end."""
    distributed = pytest.importorskip("distributed")
    threads = {
        "n_workers": 1,
        "threads_per_worker": 1,
        "processes": False,
        "dashboard_address": None,
    }
    with (
        distributed.LocalCluster(**threads) as local,
        distributed.Client(local, set_as_default=False) as client,
    ):
        work = fleet._FleetTasks(client, list(client.nthreads()), join_s=1.0, look_s=0.2)
        asked = work.run_once(time.sleep, dict.fromkeys("abc", (4.0,)))
        threading.Timer(0.5, local.scale, (0,)).start()
        with pytest.raises(OSError, match="no worker is left: what is done is kept"):
            list(asked)

"""The worker with everything real in it: loop, log, cab and the simulated machine behind bytes."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import pytest
from topdress.console.running import WorkerFailed, start_worker
from topdress.console.worker.assemble import assemble_run
from topdress.console.worker.loop_host import Host
from topdress.console.worker.options import Options
from topdress.control.orders import Do, Order
from topdress.drivers.files.read_log import read_log

HEAVY = ("textual", "rich", "numba", "scipy", "polars")


def options(tmp_path: Path, *config: str, **more) -> Options:
    return Options(config, tmp_path / "w.json", log=str(tmp_path / "run.csv"), **more)


def test_the_simulated_machine_from_power_on_to_spreading(tmp_path):
    """On an injected clock."""
    now_s = 0.0

    def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += max(seconds, 1e-9)
        host.note_console_heard()
        state = host.newest_frame.row.state if host.newest_frame else None
        if now_s > 5.0 and state in ("off", "ready"):
            host.queue_request(
                Order(Do.READY if state == "off" else Do.START),
                lambda answer, _: said.append(answer),
            )
        if now_s > 40.0:
            host.request_stop("enough")

    said: list = []
    parts = assemble_run(options(tmp_path), lambda: now_s)
    host = Host(parts, lambda: now_s, sleep)
    assert host.run_until_stopped() == "enough"
    log = read_log(parts.writer.path)
    working = [row for row in log.rows() if row.state == "working"]
    assert len(working) > 500, said
    assert max(row.applied_rate_kg_ha or 0.0 for row in working) > 100.0
    assert {device.name for device in host.newest_frame.devices} == {
        "gnss",
        *(f"head_{n}" for n in range(1, 7)),
        "board",
    }
    assert all(
        device.accepted > 50 and device.rejected == 0 for device in host.newest_frame.devices
    )
    last = list(log.rows())[-1]
    assert (
        last.state == "off"
        and last.shaft_rpm_cmd == 0.0
        and last.time_s == pytest.approx(40.0, abs=0.2)
    )
    assert (
        host.newest_frame.simulated
        and host.newest_frame.machine
        and host.newest_frame.job
        and host.newest_frame.crop
    )


async def test_the_real_program_on_the_simulated_machine(tmp_path, attach):
    where = await asyncio.to_thread(
        start_worker,
        ["--log", str(tmp_path / "run.csv"), "--seed", "3"],
        tmp_path / "trouble",
        run_file=tmp_path / "run" / "w.json",
    )
    link = await attach(where)
    assert (await link.send_order(Order(Do.READY))).accepted
    assert link.current_frame.log_path == where.log_path == str(tmp_path / "run.csv")
    await asyncio.sleep(0.5)
    stats = await link.request_stats()
    await link.stop_worker()
    assert stats["ticks"] >= 10 and stats["busy_p50_ms"] < 10.0
    rows = list(read_log(tmp_path / "run.csv").rows())
    assert rows[-1].state == "off" and len(rows) >= 10 and (tmp_path / "run.yaml").exists()
    assert (tmp_path / "trouble").read_text() == ""


def test_what_a_running_worker_has_loaded(tmp_path):
    """Imports hidden in functions are seen only after the parts were built and have run."""
    code = f"""
import sys
from pathlib import Path
from topdress.console.worker.assemble import assemble_run
from topdress.console.worker.loop_host import Host
from topdress.console.worker.options import Options
import topdress.console.worker.__main__
now = [0.0]
parts = assemble_run(Options((), Path('w.json'), log={str(tmp_path / "run.csv")!r}), lambda: now[0])
host = Host(parts, lambda: now[0], lambda s: None)
for k in range(100):
    now[0] = 0.05 * k
    host.run_one_tick(now[0])
host.close_run('')
print(*{{m.split('.')[0] for m in sys.modules}})
"""
    ended = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 0, ended.stderr
    assert not set(ended.stdout.split()) & set(HEAVY)


@pytest.mark.parametrize(
    ("files", "more", "said"),
    [
        (("nowhere",), {}, "nowhere"),
        (("huanghai_wheat",), {}, "name it in the job file"),
        (("demo", "demo"), {}, "a second file"),
        (("cab.yaml",), {}, "board.baud: value 1"),
        (("good_cab.yaml",), {"effects": ("flow.gain=8",)}, "simulated machine only"),
        ((), {"effects": ("flow.gian=8",)}, "flow.gian"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, monkeypatch, files, more, said):
    monkeypatch.chdir(tmp_path)
    Path("cab.yaml").write_text("format: topdress-cab/1\nboard: {port: COM3, baud: 1}\n")
    Path("good_cab.yaml").write_text("format: topdress-cab/1\nboard: {port: COM3}\n")
    with pytest.raises(ValueError, match=said):
        assemble_run(options(tmp_path, *files, **more), lambda: 0.0)
    assert not (tmp_path / "run.csv").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="symbolic links")
def test_a_log_in_a_loop_of_links_is_said(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    log = tmp_path / "a" / "run.csv"
    with pytest.raises(ValueError, match=f"--log {log}: its folder cannot be made"):
        assemble_run(Options((), tmp_path / "w.json", log=str(log)), lambda: 0.0)


def test_a_wrong_option_reaches_the_console_as_one_line(tmp_path):
    with pytest.raises(
        WorkerFailed, match=r"did not start: topdress worker: --log run\.txt: allowed is a name"
    ):
        start_worker(["--log", "run.txt"], tmp_path / "trouble", run_file=tmp_path / "w.json")

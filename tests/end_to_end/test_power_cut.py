"""The power is cut in the middle of work (kill -9 of console and worker); the next start goes
on with the job."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from topdress.console.worker import resume
from topdress.drivers.files.run_meta import parse_meta_yaml

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
WORKED_S = 7.0  # longer than a snapshot is old


@pytest.mark.exam
def test_kill_of_both_and_the_next_start_goes_on(benchmark_module, tmp_path):
    deaths = benchmark_module("console_deaths")
    console = deaths.Console(tmp_path)
    wait = deaths.wait
    try:
        where, watcher = deaths.at_work(console)
        begun_ha = watcher.frames[-1][1].area_ha
        time.sleep(WORKED_S)
        done = watcher.frames[-1][1]
        assert done.area_ha > begun_ha and done.row.state == "working"
        os.kill(console.terminal.process.pid, signal.SIGKILL)
        os.kill(where.pid, signal.SIGKILL)
        console.terminal.end()
        kept = resume.read_snapshot(resume.make_snapshot_path(where.log_path))
        assert not kept.finished and kept.config == (str(console.job),)

        console.terminal = console.open()
        terminal = console.terminal
        wait(lambda: terminal.shows("A job was left at"), 20.0, "the offer", terminal)
        assert not terminal.shows("WORKING")
        terminal.type("\r")
        later = console.where()
        assert later.pid != where.pid and later.log_path != where.log_path
        watcher = deaths.Watcher(later)
        wait(lambda: watcher.frames, 10.0, "frames", terminal)
        first = watcher.frames[0][1]
        assert first.row.state == "off" and (first.row.shaft_rpm_cmd or 0.0) == 0.0
        # the log's last second may be lost
        assert first.area_ha == pytest.approx(done.area_ha, rel=0.15)
        assert first.tally.log_before == where.log_path
        meta = parse_meta_yaml(
            Path(later.log_path).with_suffix(".yaml").read_text(encoding="utf-8")
        )
        assert meta.extra["resumes"] == where.log_path
        terminal.type("\x1b[21~")  # F10: the Job screen
        wait(lambda: terminal.shows("goes on from"), 10.0, "the Job screen", terminal)
        watcher.close()
    finally:
        console.terminal.end()
        console.end_worker()

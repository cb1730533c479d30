"""A working day of twelve hours: what is kept of it is bounded (docs/limits.md)."""

from __future__ import annotations

import pickle
from dataclasses import replace
from math import ceil
from pathlib import Path

import numpy as np
import pytest
from topdress.console.app.coverage_raster import CELL_SIZES_M, MAX_TILES
from topdress.console.app.frame_history import MAX_TREND_POINTS, LiveHistory
from topdress.console.worker.resume import Snapshot
from topdress.console.worker.resume_ground import MAX_TRACK_PLACES, WorkedGroundRecord
from topdress.console.worker.resume_keeper import SnapshotKeeper
from topdress.control.diagnosis.live.growing_log_check import (
    DIAGNOSIS_INTERVAL_S,
    MAX_STORED_ROWS,
    MAX_STRETCH_S,
    LiveCheck,
)
from topdress.control.field.coverage import Coverage
from topdress.control.log_row import LogRow
from topdress.control.machine.machine import Machine

from tests.app.made_up.run import run_frames

DAY_S = 12 * 3600.0
SPEED_MPS, PASS_M, WIDTH_M = 1.25, 300.0, 2.4
MB_A_HECTARE, EDGES_MB = 1.7, 6.0  # of both bitmaps, as the page has it


def place(time_s: float) -> tuple[tuple[float, float], float]:
    """Up and down a field, one pass next to the other."""
    lap, along = divmod(SPEED_MPS * time_s, PASS_M)
    return (lap * WIDTH_M, along if lap % 2 == 0 else PASS_M - along), 180.0 * (lap % 2)


def test_the_live_check_keeps_45_minutes_however_fast_they_come():
    """Also where the log's clock stands still."""
    check = LiveCheck(
        Machine(),
        lambda since, now_s: [],
        lambda columns, machine: (_ for _ in ()).throw(ValueError),
    )
    most = 0
    for begin_s in np.arange(0.0, DAY_S, 5.0):
        time_s = begin_s + np.arange(100) * 0.05
        check.add_rows(
            {"time_s": time_s, "speed_mps": np.ones(100), "state": np.full(100, "working", object)}
        )
        if check.is_due:
            check.check_rows()
        most = max(most, sum(len(piece["time_s"]) for piece in check._rows))
    assert most <= (MAX_STRETCH_S + DIAGNOSIS_INTERVAL_S) * 20 + 100
    for _ in range(1500):
        check.add_rows({"time_s": np.full(100, DAY_S), "speed_mps": np.ones(100)})
    assert sum(len(piece["time_s"]) for piece in check._rows) == check._kept <= MAX_STORED_ROWS
    whole = np.zeros((400_000, 2))
    check.add_rows({"time_s": whole[:, 0] + DAY_S, "speed_mps": whole[:, 1]})
    assert check._kept <= MAX_STORED_ROWS and all(
        column.base is None for column in check._rows[-1].values()
    ), "a copy"


@pytest.mark.exam
def test_the_console_remembers_no_more_of_twelve_hours():
    """A frame every 4 s; live there are five a second, which lie in the same pieces of the
    coarser levels."""
    history, frame = LiveHistory(), run_frames(1.0)[0]
    before = history.series.memory_bytes
    for time_s in range(0, int(DAY_S), 4):
        (east, north), heading = place(time_s)
        history.add_frame(
            replace(
                frame,
                seq=time_s,
                at_s=time_s,
                place_m=(east, north),
                row=frame.row._replace(time_s=float(time_s), heading_deg=heading),
            )
        )
    assert len(history.points) == MAX_TREND_POINTS and history.series.memory_bytes == before < 25e6
    assert history.worked.tile_count <= MAX_TILES * len(CELL_SIZES_M)
    assert history.series.start_s == 0.0, "the whole day is on the trend"


@pytest.mark.exam
def test_the_worker_s_ground_grows_with_the_ground_alone():
    done, own = WorkedGroundRecord(Machine()), Coverage(WIDTH_M)
    for time_s in np.arange(0.0, DAY_S, 3.0):
        at, heading = place(time_s)
        done.add_outlet_place(time_s, at, heading, 60.0, 300.0)
        own.extend_to(at, heading, True)
    hectares = own.covered_area.area_ha
    assert hectares == pytest.approx(DAY_S * SPEED_MPS * WIDTH_M / 1e4, rel=0.02)
    kept_mb = [len(pickle.dumps(one)) / 1e6 for one in (done, own)]
    assert sum(kept_mb) < MB_A_HECTARE * hectares + EDGES_MB and len(done.track) <= MAX_TRACK_PLACES
    for time_s in np.arange(0.0, DAY_S / 4.0, 3.0):
        at, heading = place(time_s)
        own.extend_to(at, heading, True)
    assert len(pickle.dumps(own)) / 1e6 == pytest.approx(kept_mb[1], rel=1e-3), (
        "the same ground again"
    )
    assert ceil(hectares) == 13


def test_what_waits_for_a_disk_that_hangs_is_bounded(tmp_path):
    class Loop:
        running_sums = flow_trim = plane = None

    class Tick:
        row = LogRow(1.0)

    keeper = SnapshotKeeper(
        Path(tmp_path / "a.resume.json"), Machine(), Snapshot("a.csv"), Loop(), lambda: "", 50
    )
    for _ in range(100):
        keeper.take_tick(Tick())
    assert keeper._handed.qsize() == 50

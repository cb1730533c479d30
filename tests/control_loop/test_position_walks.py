"""A GNSS place that walks off from its own speed and course: seen, said, not used; sound receivers are not accused."""
from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from control.geodesy import TangentPlane
from control.readings import GnssFix, Measurements, Reading
from control.sensing import Sensing
from control.sensing.walk_watch import WINDOWS_S

ROOT = Path(__file__).parents[2]
RECORDINGS = ROOT.parent / "shared" / "data" / "nmea"
PLANE = TangentPlane(48.0, 11.0)


@pytest.fixture(scope="module")
def walks() -> ModuleType:
    folder = str(ROOT / "benchmarks")
    spec = importlib.util.spec_from_file_location("benchmark_position_walks", ROOT / "benchmarks" / "position_walks.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["benchmark_position_walks"] = module
    sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(folder)
    return module


@pytest.mark.parametrize(("receiver", "drift_mps", "far_m", "said_s"), [
    (0, 0.5, 5.0, 10.0), (0, 3.0, 5.0, 2.0), (0, 10.0, 5.0, 1.0), (0, 30.0, 5.0, 1.0), (0, 0.25, 8.0, 35.0),
    (3, 0.5, 15.0, 35.0), (5, 3.0, 30.0, 15.0)])
def test_a_place_that_walks_is_believed_for_some_metres_only(walks, receiver, drift_mps, far_m, said_s):
    found = walks.drifting(walks.RECEIVERS[receiver], drift_mps, with_it=False)
    assert found.said_s is not None and found.said_s <= said_s and found.far_m <= far_m, found


def test_what_walks_too_slowly_is_not_seen_and_the_page_says_so(walks):
    assert walks.drifting(walks.RECEIVERS[0], 0.1, with_it=False).said_s is None
    assert "0.2 m/s" in (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("drift_mps", [3.0, 10.0, 30.0])
def test_a_receiver_whose_speed_walks_with_it_goes_farther_than_the_wheel_rolls(walks, drift_mps):
    found = walks.drifting(walks.RECEIVERS[0], drift_mps, with_it=True)
    assert found.said_s is not None and found.said_s <= 15.0 and found.far_m <= 60.0, found


class Way:
    """Straight north at 1.25 m/s, GNSS at 5 Hz; `drift` east."""

    def __init__(self) -> None:
        self.sensing, self.now_s, self.rng = Sensing(0.0, PLANE), 0.0, np.random.default_rng(3)

    def go(self, seconds, drift=lambda since_s: 0.0, wheel_mps=1.25, speed_mps=1.25, quality=4, told=True):
        found, begun_s = [], self.now_s
        for _ in range(round(seconds / 0.2)):
            self.now_s += 0.2
            east = drift(self.now_s - begun_s) + 0.01 * self.rng.standard_normal()
            lat, lon = PLANE.to_deg(east, 1.25 * self.now_s)
            fix = GnssFix(self.now_s, lat, lon, quality, 12, 0.8, speed_mps if told else None, 0.0 if told else None)
            found.append(self.sensing.update(Measurements(self.now_s, gnss=fix, wheel_speed_mps=Reading(
                wheel_mps, self.now_s))))
        return found


def test_the_place_goes_back_to_before_the_walk_and_no_flow_depends_on_the_walked_one():
    way = Way()
    way.go(70.0)
    found = way.go(20.0, lambda since_s: 1.0 * since_s)
    first = next(k for k, sensed in enumerate(found) if sensed.walks)
    assert 3.0 < 0.2 * first < 6.0
    assert found[first].moved_m == pytest.approx(0.2 * first, abs=1.5)
    assert abs(found[first].east_m) < 1.0 and abs(found[-1].east_m) < 3.0
    assert found[-1].north_m == pytest.approx(1.25 * way.now_s, abs=3.0)       # course and speed are believed on
    assert not found[-1].position_ok and found[-1].walks and found[-1].refused_m > 10.0


def test_a_place_that_comes_back_is_taken_at_once():
    way = Way()
    way.go(70.0)
    assert way.go(20.0, lambda since_s: 1.0 * since_s)[-1].walks
    found = way.go(3.0)
    taken = next(k for k, sensed in enumerate(found) if sensed.refused_m is None)
    assert 0.2 * taken <= 1.0 and abs(found[-1].east_m) < 0.1 and found[-1].position_ok


def test_a_place_that_stays_off_is_taken_after_a_minute_that_agrees():
    way = Way()
    way.go(70.0)
    way.go(12.0, lambda since_s: 1.0 * since_s)
    found = way.go(80.0, lambda since_s: 12.0)
    taken = next(k for k, sensed in enumerate(found) if sensed.refused_m is None)
    assert WINDOWS_S[-1] - 8.0 <= 0.2 * taken <= WINDOWS_S[-1] + 15.0
    assert found[taken].moved_m == pytest.approx(12.0, abs=3.0) and found[-1].position_ok


def test_one_that_goes_on_walking_is_never_taken():
    way = Way()
    way.go(70.0)
    found = way.go(300.0, lambda since_s: 0.5 * since_s)
    first = next(k for k, sensed in enumerate(found) if sensed.walks)
    assert all(sensed.walks for sensed in found[first:])
    assert all(abs(sensed.east_m) < 5.0 for sensed in found)


@pytest.mark.parametrize("wheel_mps", [1.25 * 1.08, 1.25 * 0.95, 1.25 * 0.6, 3.5, 0.7])
def test_a_wheel_that_slips_spins_or_is_calibrated_wrongly_accuses_nobody(wheel_mps):
    way = Way()
    way.go(30.0)
    assert not any(sensed.refused_m is not None for sensed in way.go(120.0, wheel_mps=wheel_mps))


def test_a_jump_is_a_jump_and_no_walk():
    way = Way()
    way.go(70.0)
    found = way.go(5.0, lambda since_s: 200.0)
    assert found[0].refused_m == pytest.approx(200.0, abs=1.0) and not any(sensed.walks for sensed in found)
    assert found[-1].refused_m is None and found[-1].east_m == pytest.approx(200.0, abs=0.1)


def test_a_change_of_the_fix_is_no_walk():
    """RTK lost and found again: float half a metre off, plain GNSS three metres."""
    way = Way()
    way.go(60.0)
    for quality, off_m in ((5, 0.5), (1, 3.0), (5, 0.5), (4, 0.0)):
        found = way.go(30.0, lambda since_s, off_m=off_m: off_m, quality=quality)
        assert not any(sensed.walks for sensed in found)


def test_a_receiver_that_tells_no_speed_is_held_to_a_quarter_of_the_way():
    way = Way()
    way.go(60.0)
    assert not any(sensed.walks for sensed in way.go(60.0, lambda since_s: 0.3 * since_s, told=False))
    assert any(sensed.walks for sensed in way.go(10.0, lambda since_s: 18.0 + 12.0 * since_s, told=False))


@pytest.mark.skipif(not RECORDINGS.exists(), reason="the recordings of receivers are not beside the checkout")
def test_recordings_of_receivers_are_not_accused(walks):
    names = sorted(path.name for path in RECORDINGS.glob("*.log"))
    accused = [name for name in names if walks.heard(walks.recorded(RECORDINGS / name)).walks]
    assert len(names) >= 10
    assert set(accused) <= set(walks.COLD_STARTS), "only one whose place jumps by 33 m in its first seconds"


@pytest.mark.parametrize("number", range(6))
def test_minutes_of_work_accuse_no_receiver(walks, number):
    """Hours: python -m benchmarks position_walks."""
    was = walks.hour(walks.RECEIVERS[number], 240.0, 100 + number)
    assert was.epochs > 100 and was.walks == 0, was

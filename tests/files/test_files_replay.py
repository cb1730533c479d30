from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from control.log_row import HOLDS_S, LogRow
from control.readings import Measurements, Reading
from drivers.files.read_log import RunLog, read_log
from drivers.files.replay import measurements
from drivers.files.run_log import write_log
from drivers.files.run_meta import RunMeta

Written = Callable[..., Path]
TICK_S = 0.05


class Sensor:
    """A sensor of a given period, silent for a while, and the cell that the loop writes for it."""

    def __init__(self, period_s: float, hold_s: float, silent: tuple[float, float] = (99.0, 99.0), seed: int = 0,
                 steady: bool = False) -> None:
        self.period_s, self.hold_s, self.silent, self.steady = period_s, hold_s, silent, steady
        self.random = np.random.default_rng(seed)
        self.newest: Reading | None = None
        self.next_s = 0.0

    def at(self, now_s: float) -> float | None:
        if now_s >= self.next_s - 1e-9:
            self.next_s += self.period_s
            if not self.silent[0] <= now_s < self.silent[1]:
                value = 25.1 if self.steady else round(float(self.random.normal(50.0, 1.0)), 3)
                self.newest = Reading(value, now_s)
        if self.newest is None or now_s - self.newest.time_s > self.hold_s + 1e-9:
            return None
        return self.newest.value


def logged(tmp_path: Path, column: str, sensor: Sensor, seconds: float = 30.0) -> tuple[RunLog, list[Reading | None]]:
    rows, truth = [], []
    for k in range(round(seconds / TICK_S)):
        rows.append(LogRow(round(k * TICK_S, 3))._replace(**{column: sensor.at(k * TICK_S)}))
        truth.append(sensor.newest)
    return read_log(write_log(tmp_path / "run.csv", RunMeta(), rows, overwrite=True)), truth


def the_reading(m: Measurements, column: str) -> Reading | None:
    return m.ndvi[0] if column == "ndvi_1" else getattr(m, column)


@pytest.mark.parametrize(("column", "period_s"), [("shaft_rpm", 0.05), ("opening_mm", 0.1), ("wheel_speed_mps", 0.2),
                                                  ("hopper_kg", 0.1)])
def test_values_and_their_times_come_back(tmp_path: Path, column: str, period_s: float) -> None:
    log, truth = logged(tmp_path, column, Sensor(period_s, HOLDS_S[column], silent=(10.0, 15.0)))
    for m, true in zip(measurements(log), truth, strict=True):
        reading = the_reading(m, column)
        assert reading is not None and true is not None
        assert reading.value == true.value
        assert reading.time_s == pytest.approx(true.time_s, abs=TICK_S + 1e-6), (m.time_s, reading, true)


def test_a_silent_head_grows_old_as_it_did(tmp_path: Path) -> None:
    sensor = Sensor(0.5, HOLDS_S["ndvi_1"], silent=(10.0, 20.0))
    sensor.random = np.random.default_rng(3)
    original = sensor.random.normal
    sensor.random = type("R", (), {"normal": staticmethod(lambda *_: original(0.5, 0.01))})()  # type: ignore[assignment]
    log, truth = logged(tmp_path, "ndvi_1", sensor)
    for m, true in zip(measurements(log), truth, strict=True):
        reading = m.ndvi[0]
        assert reading is not None and true is not None
        assert (reading.value, reading.time_s) == (true.value, pytest.approx(true.time_s, abs=TICK_S + 1e-6))


def test_a_steady_value_that_comes_is_never_taken_for_silence(tmp_path: Path) -> None:
    log, truth = logged(tmp_path, "opening_mm", Sensor(0.05, HOLDS_S["opening_mm"], silent=(20.0, 99.0), steady=True))
    for m, true in zip(measurements(log), truth, strict=True):
        assert m.opening_mm is not None and true is not None
        age_s, true_age_s = m.time_s - m.opening_mm.time_s, m.time_s - true.time_s
        assert age_s == pytest.approx(true_age_s, abs=HOLDS_S["opening_mm"] + TICK_S)
        if m.time_s < 19.0:
            assert age_s < TICK_S
        if m.time_s > 20.6:
            assert age_s == pytest.approx(true_age_s, abs=TICK_S + 1e-6)


def test_a_rare_change_is_not_a_slow_sensor(written: Written) -> None:
    lines = [f"{k * 0.05:.2f},{25 if k < 300 else 26}" for k in range(600)]
    log = read_log(written("time_s,opening_mm\n" + "\n".join(lines) + "\n"))
    for m in measurements(log):
        assert m.opening_mm is not None
        assert m.time_s - m.opening_mm.time_s <= HOLDS_S["opening_mm"] / 2 + 1e-6


def test_never_received_is_none_and_no_sensor_stays_none(written: Written) -> None:
    log = read_log(written("time_s,hopper_kg,work_switch\n0,,\n1,5,1\n2,,0\n"))
    first, second, third = measurements(log)
    assert first.hopper_kg is None and second.hopper_kg == Reading(5.0, 1.0) and third.hopper_kg == Reading(5.0, 1.0)
    assert (first.work_switch, second.work_switch, third.work_switch) == (None, True, False)
    assert first.gnss is None and first.shaft_rpm is None and third.ndvi == (None,)


def test_a_new_utc_makes_a_new_fix(written: Written) -> None:
    lines = ["time_s,utc,lat_deg,lon_deg,fix_quality,satellites,speed_mps,heading_deg"]
    for k in range(20):
        tenth = k // 4
        lines.append(f"{k * 0.05:.2f},2026-03-20T08:00:00.{2 * tenth}00Z,34.1,119.5,4,12,0.0,")
    log = read_log(written("\n".join(lines) + "\n"))
    for k, m in enumerate(measurements(log)):
        assert m.gnss is not None
        assert m.gnss.time_s == pytest.approx(k // 4 * 0.2)
        assert m.gnss.utc == f"2026-03-20T08:00:00.{2 * (k // 4)}00Z"
        assert (m.gnss.fix_quality, m.gnss.satellites, m.gnss.hdop, m.gnss.heading_deg) == (4, 12, None, None)


def test_a_lost_fix_stays_the_newest_and_grows_old(written: Written) -> None:
    lines = ["time_s,utc,lat_deg,lon_deg"]
    lines += [f"{k / 10:.1f},2026-03-20T08:00:00.{k}00Z,{34.1 + k * 1e-6:.6f},119.5" for k in range(5)]
    lines += [f"{k / 10:.1f},,," for k in range(5, 9)]
    lines += ["0.9,2026-03-20T08:00:00.900Z,34.2,119.5"]
    fixes = [m.gnss for m in measurements(read_log(written("\n".join(lines) + "\n")))]
    assert [fix.time_s for fix in fixes if fix] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.4, 0.4, 0.4, 0.4, 0.9])
    assert fixes[8] is not None and fixes[8].lat_deg == pytest.approx(34.100004)
    assert fixes[8].fix_quality == 1


def test_a_place_that_comes_after_its_utc_is_as_old_as_itself(written: Written) -> None:
    utc = "2026-03-20T08:00:00.000Z"
    log = read_log(written(f"time_s,utc,lat_deg,lon_deg\n0,{utc},,\n1,{utc},34.1,119.5\n2,{utc},34.1,119.5\n"))
    assert [m.gnss and m.gnss.time_s for m in measurements(log)] == [None, 1.0, 1.0]


def test_without_utc_a_new_place_makes_a_new_fix(written: Written) -> None:
    lines = [f"{k * 0.05:.2f},{34.1 + k // 2 * 1e-6:.6f},119.5" for k in range(40)]
    log = read_log(written("time_s,lat_deg,lon_deg\n" + "\n".join(lines) + "\n"))
    assert [m.gnss.time_s for m in measurements(log) if m.gnss] == pytest.approx([k // 2 * 0.1 for k in range(40)])


def test_a_speed_without_places_is_replayed_as_the_wheel(written: Written) -> None:
    log = read_log(written("time_s,speed_mps,ndvi\n0,1.2,0.5\n1,1.3,0.6\n"))
    readings = [m.wheel_speed_mps for m in measurements(log)]
    assert [reading.value for reading in readings if reading] == [1.2, 1.3]


def test_an_empty_log_replays_nothing(written: Written) -> None:
    log = read_log(written("time_s,speed_mps\n"))
    assert list(measurements(log)) == [] and list(log.rows()) == []

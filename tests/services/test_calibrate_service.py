"""What the Calibrate screen computes and saves: fits that find what was put in, new files,
nothing overwritten."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from topdress.console.app.pages.calibrate.catch_test import CatchPoint
from topdress.console.app.pages.calibrate.wheel_drive import WheelSample
from topdress.console.services.calibrate import make_calibrate_service
from topdress.drivers.files.bench_table import read_bench_table
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

from tests.places import PAPERS

SETTINGS = ((30.0, 15.0), (50.0, 25.0), (70.0, 35.0), (90.0, 45.0), (90.0, 15.0), (60.0, 55.0))


@pytest.fixture
def machine():
    return load_config("huanghai", MACHINE_KIND).model


@pytest.fixture
def job(machine, tmp_path):
    return make_calibrate_service(machine, folder=tmp_path / "machines")


def catches(grams=5.7, falloff=0.0, noise=0.002, settings=SETTINGS):
    random = np.random.default_rng(3)
    return [
        CatchPoint(
            rpm,
            mm,
            30.0,
            grams
            * mm
            * (1.0 - falloff / 100.0 * (rpm / 100.0) ** 3)
            * rpm
            / 60.0
            * 0.030
            * (1.0 + noise * random.standard_normal()),
        )
        for rpm, mm in settings
    ]


def test_the_flow_that_was_put_in_is_found_and_the_line_goes_through_the_points(job):
    found = job.fit_catch(catches())
    flow = found.estimates[0]
    assert flow.low < 5.7 < flow.high and flow.high - flow.low < 0.1
    assert found.x_name == "opening mm" and len(found.points) == len(SETTINGS)
    for x, y in found.points:
        near = min(found.line, key=lambda one: abs(one.x - x))
        assert y == pytest.approx(near.y, rel=0.05)
        assert near.low < near.y < near.high


def test_a_fall_off_is_taken_out_of_the_points_beside_the_line(job):
    found = job.fit_catch(catches(falloff=12.0))
    assert found.estimates[2].value == pytest.approx(12.0, abs=1.5)
    inside = sum(
        min(found.line, key=lambda one: abs(one.x - x)).low * 0.99
        <= y
        <= min(found.line, key=lambda one: abs(one.x - x)).high * 1.01
        for x, y in found.points
    )
    assert inside >= len(found.points) - 1


def test_where_only_the_speed_was_changed_the_line_is_over_speed(job):
    found = job.fit_catch(
        catches(falloff=10.0, settings=((20.0, 30.0), (50.0, 30.0), (80.0, 30.0), (100.0, 30.0)))
    )
    assert found.x_name == "shaft r/min" and found.line[0].x == pytest.approx(20.0)
    assert found.line[-1].y < found.line[0].y


def test_too_few_catches_are_one_line(job):
    with pytest.raises(ValueError, match="at least 2") as error:
        job.fit_catch(catches()[:1])
    assert "\n" not in str(error.value)


def test_a_new_machine_file_says_where_it_comes_from_and_the_old_one_stays(job, machine, tmp_path):
    found = job.fit_catch(catches())
    path = Path(job.save(found, "mine"))
    new = load_config(path, MACHINE_KIND).model
    assert new.flow.grams_per_rev_mm == pytest.approx(found.estimates[0].value, rel=1e-3)
    record = next(one for one in new.adopted if one.id == "flow.grams_per_rev_mm")
    table = read_bench_table(record.data)
    assert table.kind == "catch" and table.rows == len(SETTINGS)
    assert record.low < record.size < record.high and record.date
    assert machine.flow.grams_per_rev_mm == 5.5
    before = path.read_bytes()
    with pytest.raises(ValueError, match=r"mine\.yaml: exists already: nothing is overwritten"):
        job.save(found, "mine")
    assert path.read_bytes() == before
    assert job.name_for("catch") not in ("", "mine")


def test_a_wheel_is_fitted_by_the_circumference_it_was_counted_by_and_saved(machine, tmp_path):
    job = make_calibrate_service(machine, 2.60, tmp_path)
    random = np.random.default_rng(5)
    samples = [
        WheelSample(
            0.2 * k, 34.8 + (0.4 * k + 0.01 * random.standard_normal()) / 110_940.0, 113.6, 4, 2.02
        )
        for k in range(400)
    ]
    found = job.fit_wheel(samples)
    circumference = found.estimates[0]
    assert circumference.value == pytest.approx(2.60 / 1.01, rel=1e-3)
    assert (
        circumference.low < circumference.value < circumference.high < 1.005 * circumference.value
    )
    new = load_config(Path(job.save(found, "wheel.yaml")), MACHINE_KIND).model
    assert new.speed.wheel_circumference_m == circumference.value
    assert "Calibrate page" in new.adopted[-1].data
    with pytest.raises(ValueError, match="at least"):
        job.fit_wheel(samples[:100])


def test_a_reference_of_effort_is_saved_as_it_was_fitted(machine, tmp_path):
    """From a run's log; what the log gained since is not in the file."""
    log, job, rng = (
        tmp_path / "run.csv",
        make_calibrate_service(machine, folder=tmp_path / "machines"),
        np.random.default_rng(3),
    )
    rpm, mm = (
        np.repeat(rng.uniform(20.0, 90.0, 60), 100),
        np.repeat(rng.uniform(10.0, 40.0, 20), 300),
    )
    effort = 12.0 + 0.4 * rpm + 0.05 * 5.5 * mm + rng.standard_normal(6000)
    np.savetxt(
        log,
        np.column_stack((0.05 * np.arange(6000), rpm, rpm, mm, mm, effort)),
        delimiter=",",
        comments="",
        header="time_s,shaft_rpm_cmd,shaft_rpm,opening_mm_cmd,opening_mm,shaft_effort",
        fmt="%.3f",
    )
    found = job.fit_effort(str(log))
    assert [one.name for one in found.estimates] == ["coulomb", "viscous", "load"]
    log.unlink()
    new = load_config(Path(job.save(found, "effort")), MACHINE_KIND).model
    assert [getattr(new.effort, one.name) for one in found.estimates] == [
        one.value for one in found.estimates
    ]
    assert (new.effort.coulomb, new.effort.viscous, new.effort.load) == pytest.approx(
        (12.0, 0.4, 0.05), rel=0.05
    )


def test_the_papers_lag_tables_are_offered_fitted_and_saved(machine, tmp_path):
    job = make_calibrate_service(machine, folder=tmp_path, tables=(PAPERS,))
    offered = {Path(table.path).name: table for table in job.lag_tables()}
    assert {"lag_table1_distance.csv", "lag_table3_drop_time.csv", "lag_table4_total.csv"} <= set(
        offered
    )
    assert "lag_table2_response.csv" not in offered, "a response holds no drop time"
    table = offered["lag_table4_total.csv"]
    assert table.labels == ("detected", "field")
    found = job.fit_lag(table.path, "detected")
    assert found.range == (10.0, 70.0) and found.estimates[0].value == pytest.approx(
        -0.0083, abs=0.0005
    )
    assert len(found.points) > len([x for x, _y in found.points if x <= 70.0]), (
        "points outside the range are shown"
    )
    assert (
        load_config(Path(job.save(found, "lag")), MACHINE_KIND).model.fall.slope_s_per_rpm
        == found.estimates[0].value
    )


def test_a_file_that_is_no_lag_table_is_one_line(job, tmp_path):
    wrong = tmp_path / "wrong.csv"
    wrong.write_text("a,b\n1,2\n")
    with pytest.raises(Exception, match=r"wrong\.csv") as error:
        job.open_lag_table(str(wrong))
    assert "\n" not in str(error.value)
    with pytest.raises(Exception, match=r"no\.csv"):
        job.open_lag_table(str(tmp_path / "no.csv"))

"""The simulated machine of `control.simulation` behind the bytes: what the cab measures is what the plant sensed."""
from __future__ import annotations

import statistics

import pytest

from control.field.job import Job
from control.machine.machine import Machine
from control.readings import DriveCommand
from control.simulation.plant import Plant
from drivers.virtual.machine import virtual_cab


def test_thirty_seconds_of_the_real_plant(clock):
    plant = Plant(Machine(), Job(), seed=3)
    sensed = []
    step = plant.step
    plant.step = lambda command, enabled: sensed.append(step(command, enabled)) or sensed[-1]
    cab, machine = virtual_cab(plant, clock)
    wheel_errors = []
    for tick in range(600):
        clock.now_s += 0.05
        machine.advance(clock.now_s)
        m = cab.measure(clock.now_s)
        cab.command(clock.now_s, DriveCommand(60.0, 30.0), tick > 20)
        last = sensed[-1]
        assert m.shaft_rpm.value == pytest.approx(last.shaft_rpm, abs=5e-4)
        assert m.opening_mm.value == pytest.approx(last.opening_mm, abs=5e-4)
        assert m.hopper_kg.value == pytest.approx(last.hopper_kg, abs=5e-4)
        if last.gnss is not None and tick > 5:
            assert m.gnss.time_s == clock.now_s, "no tick of latency"
            assert m.gnss._replace(time_s=0) == last.gnss._replace(
                time_s=0, lat_deg=pytest.approx(last.gnss.lat_deg, abs=2e-9),
                lon_deg=pytest.approx(last.gnss.lon_deg, abs=2e-9),
                speed_mps=pytest.approx(last.gnss.speed_mps, abs=3e-4),
                heading_deg=pytest.approx(last.gnss.heading_deg, abs=6e-4))
        if last.ndvi is not None:
            assert [reading.value for reading in m.ndvi] == pytest.approx(last.ndvi, abs=6e-4)
        if tick > 300:
            wheel_errors.append(m.wheel_speed_mps.value - plant.truth.speed_mps)
    assert m.shaft_rpm.value == pytest.approx(60.0, abs=2.0)
    assert all(device.rejected == 0 for device in cab.status(clock.now_s))
    assert abs(statistics.mean(wheel_errors)) < 0.01
    assert statistics.pstdev(wheel_errors) < 0.06

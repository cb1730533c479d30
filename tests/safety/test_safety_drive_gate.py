"""Nothing but finite numbers inside the limits reaches a drive."""
from __future__ import annotations

from math import inf, isfinite, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.readings import DoseOrder, DriveCommand
from control.safety import DriveLimits, limited, limited_dose

LIMITS = DriveLimits(shaft_min_rpm=10.0, shaft_max_rpm=90.0, opening_min_mm=5.0, opening_max_mm=50.0)
ANY = st.floats(allow_nan=True, allow_infinity=True)


@given(ANY, ANY, st.booleans(), st.none() | ANY)
def test_any_number_comes_out_finite_and_inside(shaft_rpm, opening_mm, flow_allowed, now_mm):
    sent = limited(DriveCommand(shaft_rpm, opening_mm), LIMITS, flow_allowed, now_mm)
    assert isfinite(sent.shaft_rpm) and isfinite(sent.opening_mm)
    assert sent.shaft_rpm == 0.0 or LIMITS.shaft_min_rpm <= sent.shaft_rpm <= LIMITS.shaft_max_rpm
    assert LIMITS.opening_min_mm <= sent.opening_mm <= LIMITS.opening_max_mm
    if not (flow_allowed and isfinite(shaft_rpm) and isfinite(opening_mm)):
        assert sent.shaft_rpm == 0.0


@given(st.just(0.0) | st.floats(10.0, 90.0), st.floats(5.0, 50.0))
def test_a_command_inside_the_limits_is_not_touched(shaft_rpm, opening_mm):
    assert limited(DriveCommand(shaft_rpm, opening_mm), LIMITS, True) == DriveCommand(shaft_rpm, opening_mm)


@pytest.mark.parametrize(("wanted_rpm", "sent_rpm"), [
    (-3.0, 0.0), (4.9, 0.0), (5.0, 10.0), (9.9, 10.0), (90.1, 90.0), (1e308, 90.0)])
def test_shaft_limits(wanted_rpm, sent_rpm):
    assert limited(DriveCommand(wanted_rpm, 20.0), LIMITS, True).shaft_rpm == sent_rpm


@pytest.mark.parametrize("cmd", [DriveCommand(nan, 40.0), DriveCommand(50.0, inf), DriveCommand(nan, nan)])
def test_without_sense_the_shaft_stops_and_the_gate_stays(cmd):
    assert limited(cmd, LIMITS, True, opening_now_mm=22.0) == DriveCommand(0.0, 22.0)


def test_without_flow_the_shaft_stops_and_the_gate_stays():
    assert limited(DriveCommand(70.0, 40.0), LIMITS, False, opening_now_mm=22.0) == DriveCommand(0.0, 22.0)
    assert limited(DriveCommand(70.0, 40.0), LIMITS, False) == DriveCommand(0.0, 40.0)


def test_a_gate_that_stands_nowhere_known_is_closed():
    closed = DriveCommand(0.0, LIMITS.opening_min_mm)
    assert limited(DriveCommand(70.0, nan), LIMITS, True) == closed
    assert limited(DriveCommand(70.0, nan), LIMITS, True, opening_now_mm=nan) == closed


@given(ANY, ANY, st.booleans())
def test_a_dose_comes_out_finite_and_inside_or_not_at_all(angle_deg, shaft_rpm, flow_allowed):
    sent = limited_dose(DoseOrder(angle_deg, shaft_rpm), LIMITS, flow_allowed)
    sensible = isfinite(angle_deg) and isfinite(shaft_rpm) and angle_deg > 0.0 and shaft_rpm > 0.0
    assert (sent is not None) == (flow_allowed and sensible)
    if sent is not None:
        assert 0.0 < sent.angle_deg <= 3600.0 and 10.0 <= sent.shaft_rpm <= 90.0


def test_a_dose_inside_the_limits_is_not_touched():
    assert limited_dose(DoseOrder(120.0, 70.0), LIMITS, True) == DoseOrder(120.0, 70.0)
    assert limited_dose(DoseOrder(120.0, 70.0), LIMITS, False) is None

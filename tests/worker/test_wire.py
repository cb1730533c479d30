from __future__ import annotations

import json

import pytest

from console.frame import DeviceTest, DeviceView, Frame, LagTestView, from_json
from console.worker import wire
from control.agronomy.strips import Strips
from control.field.totals import Totals
from control.log_row import LogRow
from control.orders import Alarm, Answer, Severity
from control.safety import Allowances, BenchRun


def test_a_frame_comes_back_as_it_was():
    frame = Frame(3, 1.5, LogRow(1.5, state="working", ndvi_3=0.61), alarms=(
        Alarm("rate_off", Severity.AMBER, 1.0, details=(("percent", 12.0), ("word", "x"))),), dropped_heads=(2,),
        place_m=(1.0, 2.0), notes=("n",),
        devices=(DeviceView("gnss", "COM3", "nmea", True, 0.1, 10.0, 5, 1, "$GPGGA", 2, 5000, 30, "late",
                            (("bad_checksum", 1),), False, "run.gnss.1.capture",
                            DeviceTest(False, "nmea0183", 9600, 12, 1, "$GPGGA")),),
        lag_test=LagTestView("running", 40.0, 3, 0.25, ((10.0, 0.38, 1.7), (20.0, 0.38, 1.6)), 1, "late",
                             "x.lag.1.csv"),
        why_no_flow=("low_speed", "reversing"), why_state="standstill", allow=Allowances(outside=True),
        no_double=False, threshold_m=0.04, strips=Strips(0.66, None),
        totals=Totals(1.0, 300.0, 138.0, 310.0, 600.0, 300.0, 4.0, 96.0, None), head_ndvi=(0.5, None, 0.6),
        bench=BenchRun(50.0, 25.0, 3.2, 116.8))
    assert from_json(json.loads(wire.framed(frame))) == frame


def test_an_older_workers_frame_lacks_nothing_that_the_console_needs():
    message = json.loads(wire.framed(Frame(3, 1.5, LogRow(1.5))))
    older = {name: message[name] for name in ("seq", "at_s", "row")} | {"of_tomorrow": 1}
    assert from_json(older) == Frame(3, 1.5, LogRow(1.5))


def test_one_value_that_is_not_finite_does_not_blind_the_console():
    frame = Frame(3, 1.5, LogRow(1.5, shaft_rpm=float("nan"), hopper_kg=float("inf"), ndvi=0.5))
    row = from_json(json.loads(wire.framed(frame))).row
    assert row == LogRow(1.5, shaft_rpm=None, hopper_kg=None, ndvi=0.5)
    with pytest.raises(ValueError):
        wire.framed(Frame(3, float("nan"), LogRow(1.5)))


def test_every_message_is_one_line():
    for line in (wire.greeting(7), wire.answered(1, Answer(False, "a\nb"), {"stats": {"x": 1}}),
                 wire.framed(Frame(1, 0.0, LogRow(0.0, events="mark a\nb")))):
        assert line.endswith(b"\n") and line.count(b"\n") == 1


def test_what_a_newer_worker_adds_anywhere_is_passed_over():
    frame = Frame(3, 1.5, LogRow(1.5), alarms=(Alarm("rate_off", Severity.AMBER, 1.0), Alarm("x", Severity.RED, 2.0)),
                  devices=(DeviceView("gnss", "COM3", "nmea", True, 0.1, 10.0, 5, 1),), totals=None, strips=Strips(0.6))
    newer = json.loads(wire.framed(frame))
    for place in (newer, newer["row"], newer["alarms"][1], newer["devices"][0], newer["strips"]):
        place["of_tomorrow"] = {"a": 1}
    assert from_json(newer) == frame


def test_a_frame_that_is_none_is_one_line():
    broken = json.loads(wire.framed(Frame(3, 1.5, LogRow(1.5)))) | {"area_ha": "much"}
    with pytest.raises(ValueError, match=r"^area_ha: [^\n]*$"):
        from_json(broken)

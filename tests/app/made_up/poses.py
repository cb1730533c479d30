"""Brings the Devices and Calibrate screens to what their pictures show."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from topdress.console.app.pages.calibrate.catch_calibration import CatchCalibration
from topdress.console.app.pages.calibrate.catch_test import ShaftTurns
from topdress.console.app.pages.calibrate.heads_calibration import (
    CHECK_DURATION_S,
    HeadsCalibration,
)
from topdress.console.app.pages.calibrate.page import CalibrateScreen
from topdress.console.app.pages.calibrate.wheel_calibration import WheelCalibration
from topdress.console.app.pages.calibrate.wheel_drive import WheelDrive
from topdress.console.app.pages.devices.page import DevicesScreen
from topdress.control.safety import BenchRun

from tests.app.made_up.calibrate import POINTS, lag_under_way, many_devices, standing

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp
    from topdress.console.frame import Frame

KINDS = ("catch", "lag", "heads", "wheel")


def pose(app: TopdressApp, screen: str, frame: Frame) -> Frame:
    """The frame that the picture's source is to have. screen: devices, calibrate,
    calibrate-running, calibrate-lag, calibrate-heads, calibrate-wheel."""
    page = app.page
    if isinstance(page, DevicesScreen):
        page.picked = "board"
        return many_devices(frame)
    assert isinstance(page, CalibrateScreen)
    kind = screen.partition("-")[2]
    page.at = KINDS.index(kind) if kind in KINDS else 0
    frame = standing(frame)
    calibration = page.calibration
    if isinstance(calibration, CatchCalibration):
        calibration.test.points = list(POINTS)
        if kind == "running":
            calibration.test.points.pop()
            calibration.test.change_setting(90.0, 50.0)
            calibration.test.phase, calibration.test.shaft_turns = (
                "weigh",
                ShaftTurns(12.4, 18.6, 18.6 * 90.0, 18.6 * 50.0),
            )
            row = frame.row._replace(state="calibrating", shaft_rpm=89.8, opening_mm=50.0)
            return replace(frame, row=row, bench=BenchRun(90.0, 50.0, 12.6, 107.4))
        assert page.service is not None
        calibration.take_result(page.service.fit_catch(POINTS))
    elif isinstance(calibration, HeadsCalibration):
        _check_heads(calibration, frame)
    elif isinstance(calibration, WheelCalibration):
        calibration.run.running, calibration.run.drive = (
            True,
            WheelDrive(132.4, 133.1, 0.18, 70.2, 4),
        )
    else:
        frame = replace(
            lag_under_way(many_devices(frame)),
            bench=BenchRun(40.0, 25.0, 2.1, 117.9),
            row=frame.row._replace(state="calibrating", shaft_rpm=39.8),
        )
    return frame


def _check_heads(calibration: HeadsCalibration, frame: Frame) -> None:
    """One head 0.05 low, one silent for most of the time."""
    calibration.check.start_check(0.0)
    for index in range(int(CHECK_DURATION_S / 0.2) + 1):
        wave = 0.55 + 0.02 * ((index * 7) % 11 - 5) / 5
        heads: list[float | None] = [
            wave + 0.006 * ((index * (3 + n)) % 7 - 3) / 3 for n in range(6)
        ]
        heads[4] = (heads[4] or 0.0) - 0.05
        heads[2] = heads[2] if index < 20 else None
        calibration.check.add_frame(0.2 * index, heads)

"""Made-up calibrations for pictures and tests: the same every time, no model behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from topdress.console.app.pages.calibrate.catch_test import CatchPoint
from topdress.console.app.pages.calibrate.service import (
    CalibrateService,
    CalibrationResult,
    CurvePoint,
    Estimate,
    LagTable,
)
from topdress.console.app.pages.calibrate.wheel_drive import WheelSample
from topdress.console.frame import DeviceTest, DeviceView, Frame, LagTestView

GRAMS = 5.5
POINTS = (
    CatchPoint(40.0, 20.0, 30.4, 2.221),
    CatchPoint(70.0, 20.0, 30.1, 3.874),
    CatchPoint(70.0, 35.0, 29.8, 6.668),
    CatchPoint(90.0, 50.0, 20.2, 8.312),
)
RUNS = tuple(
    (10.0 * step, 0.383, 1.829 - 0.0083 * 10.0 * step + 0.02 * (step % 3 - 1))
    for step in range(1, 8)
)
TABLES = (
    LagTable("bench/lag_march.csv", 70),
    LagTable("bench/lag_both.csv", 20, ("detected", "field")),
)
REJECTED = (("bad_crc", 3), ("overlong", 1))


def _catch(points: Sequence[CatchPoint]) -> CalibrationResult:
    if len(points) < 3:
        raise ValueError(f"{len(points)} catches: at least 3 are needed")
    line = tuple(
        CurvePoint(mm, GRAMS * mm, 0.98 * GRAMS * mm, 1.02 * GRAMS * mm) for mm in range(20, 51, 2)
    )
    return CalibrationResult(
        "catch",
        (
            Estimate("grams_per_rev_mm", 5.4972, 5.4713, 5.5231, "g/rev/mm", 4),
            Estimate("zero_offset", None, None, None, "g/rev", 2),
            Estimate("fill_falloff", 3.1, 1.2, 5.0, "%", 1),
        ),
        tuple((one.opening_mm, one.grams_per_revolution) for one in points),
        line,
        "opening mm",
        "g per turn",
        scatter="0.41 %",
        source=tuple(points),
    )


def _lag(path: str, label: str | None) -> CalibrationResult:
    line = tuple(
        CurvePoint(rpm, 2.212 - 0.0083 * rpm, 2.152 - 0.0083 * rpm, 2.272 - 0.0083 * rpm)
        for rpm in range(10, 71, 5)
    )
    return CalibrationResult(
        "lag",
        (
            Estimate("slope", -0.0083, -0.0091, -0.0075, "s per r/min", 5),
            Estimate("intercept", 2.212, 2.18, 2.244, "s", 3),
        ),
        tuple((rpm, response_s + drop_s) for rpm, response_s, drop_s in RUNS),
        line,
        "shaft r/min",
        "lag s",
        (10.0, 70.0),
        "0.019 s",
        (path, label),
    )


def _wheel(samples: Sequence[WheelSample]) -> CalibrationResult:
    return CalibrationResult(
        "wheel", (Estimate("circumference", 2.4868, 2.4849, 2.4887, "m", 4),), source=tuple(samples)
    )


def _effort(path: str) -> CalibrationResult:
    return CalibrationResult(
        "effort",
        (
            Estimate("coulomb", 8.11, 7.6, 8.62, "%", 4),
            Estimate("viscous", 0.598, 0.59, 0.606, "% for each r/min", 4),
        ),
        scatter="0.33 %",
        source=(path,),
    )


def _save(fitted: CalibrationResult, name: str) -> str:
    if name == "taken":
        raise ValueError("machines/taken.yaml: exists already: nothing is overwritten")
    return f"machines/{name}.yaml"


def sample_calibrate_job() -> CalibrateService:
    return CalibrateService(
        machine="huanghai",
        shaft_rpm=(10.0, 100.0),
        opening_mm=(5.0, 60.0),
        set_shaft_rpm=70.0,
        set_opening_mm=25.0,
        wheel_circumference_m=2.5,
        most_kg=300.0,
        expected_kg=lambda shaft_rpm, opening_mm, revolutions: (
            GRAMS * opening_mm * revolutions / 1000.0
        ),
        fit_catch=_catch,
        lag_tables=lambda: TABLES,
        open_lag_table=lambda path: LagTable(path, 70),
        fit_lag=_lag,
        fit_wheel=_wheel,
        fit_effort=_effort,
        save=_save,
        name_for=lambda kind: f"huanghai-{kind}-20260318",
    )


def standing(frame: Frame, state: str = "ready") -> Frame:
    """The same frame of a machine that stands."""
    row = frame.row._replace(
        state=state,
        speed_mps=0.0,
        wheel_speed_mps=0.0,
        speed_used_mps=0.0,
        shaft_rpm=0.0,
        shaft_rpm_cmd=0.0,
        opening_mm=25.0,
        target_rate_kg_ha=0.0,
        applied_rate_kg_ha=0.0,
    )
    return replace(frame, row=row, seq=frame.seq + 1)


def many_devices(frame: Frame) -> Frame:
    """The same frame with ten lines: one silent, one disconnected, one without its plug, one
    captured."""

    def view(name: str, protocol: str, port: str, raw: str, **more: Any) -> DeviceView:
        return replace(
            DeviceView(name, port, protocol, True, 0.06, 10.0, 3990, 0, raw, 1, 231_804, 0), **more
        )

    heads = [
        view(
            f"head_{n}",
            "greenseeker",
            f"/dev/ttyUSB{n}",
            f"0,0,0.5{n},0.48,0",
            rate_hz=2.0,
            accepted=798,
        )
        for n in range(1, 7)
    ]
    heads[3] = replace(
        heads[3],
        connected=False,
        age_s=35.2,
        rate_hz=0.0,
        last_error="device reports readiness to read but returned no data (device disconnected or "
        "multiple access on port?)",
    )
    heads[4] = replace(heads[4], plugged=False, connected=False, age_s=92.0, rate_hz=0.0)
    gnss = view(
        "gnss",
        "nmea0183",
        "/dev/ttyUSB0",
        "$GNGGA,061838.80,3448.0123,N,11336.0123,E,4,18,0.7,81.2,M,,M,,*5A",
        capture_path="logs/20260318-061200.gnss.1.capture",
    )
    board = view(
        "board",
        "slave-board/1",
        "/dev/ttyACM0",
        "$B1,20311,7012,2204,1384,29.85,13.4,0*3F2A",
        rate_hz=50.0,
        accepted=19_950,
        rejected=4,
        rejected_kinds=REJECTED,
        bytes_out=402_118,
    )
    rig = view(
        "lag_rig",
        "lag-rig/1",
        "/dev/ttyACM1",
        "$L1,5,0,0,81200,0.0,3,,,0*11AB",
        age_s=4.2,
        rate_hz=0.0,
        test=DeviceTest(True, "", None, 0, 0, ""),
    )
    return replace(frame, seq=frame.seq + 1, devices=(gnss, *heads, board, rig))


def lag_under_way(frame: Frame) -> Frame:
    test = LagTestView(
        "running",
        40.0,
        2,
        0.16,
        RUNS,
        1,
        "30 r/min, repeat 1: nothing landed",
        "logs/run.lag.1.csv",
    )
    return replace(frame, lag_test=test)

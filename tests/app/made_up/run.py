"""A made-up run for the gallery and the tests: seeded, the same on every machine, no model
behind it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from math import cos, floor, sin
from random import Random

import numpy as np
from topdress.console.app.coverage_raster import OutletSpot, WorkedGround
from topdress.console.app.field_picture import FieldPicture, PlannedRates
from topdress.console.app.map_layers import MapLayer
from topdress.console.app.overlay_file import OverlayFile
from topdress.console.app.pages.replay.service import LogFile
from topdress.console.app.pages.settings.service import SettingsStore
from topdress.console.app.services import Services
from topdress.console.frame import DeviceView, Frame, JobCounts
from topdress.control.field.job_totals import Totaliser
from topdress.control.log_row import LogRow
from topdress.control.orders import Alarm, Severity
from topdress.control.readings import EffortFinding
from topdress.drivers.files.settings import Settings

from tests.app.made_up.calibrate import sample_calibrate_job
from tests.app.made_up.diagnosis import MadeUpDiagnosis
from tests.app.made_up.job import SampleJobService

_BEGAN = datetime(2026, 3, 18, 6, 12, 0, tzinfo=UTC)
REFILLS = (("2026-03-18T06:13:05Z", 120.0), ("2026-03-18T06:16:40Z", 80.0))
_PASS_M = 70.0
_WIDTH_M = 2.4
_SPEED_MPS = 1.9


def _place(travelled_m: float) -> tuple[float, float, float]:
    """East, north (m) and heading (degrees) on a field of up-and-down passes."""
    lap, along = divmod(travelled_m, _PASS_M)
    upward = int(lap) % 2 == 0
    return lap * _WIDTH_M * 1.5, along if upward else _PASS_M - along, 0.0 if upward else 180.0


def _ndvi(east_m: float, north_m: float) -> float:
    return 0.52 + 0.07 * sin(north_m / 17) * cos(east_m / 13) + 0.03 * sin(north_m / 5 + east_m)


def _rate(ndvi: float) -> float:
    """Falls with NDVI in steps, as graded decisions do."""
    upper = (floor(ndvi / 0.05) + 1) * 0.05
    return max(0.0, 760.0 - 820.0 * upper)


def run_frames(
    seconds: float = 400.0, step_s: float = 0.2, seed: int = 7, alarms: tuple[Alarm, ...] = ()
) -> list[Frame]:
    """Frames of a quiet working run; `alarms` stand on every frame."""
    random = Random(seed)
    frames: list[Frame] = []
    applied = 0.0
    kg = 0.0
    area_ha = 0.0
    worked = Totaliser(_WIDTH_M, 0.45)
    for index in range(int(seconds / step_s)):
        time_s = index * step_s
        east, north, heading = _place(_SPEED_MPS * time_s)
        ndvi = _ndvi(east, north)
        target = _rate(ndvi)
        applied += (target - applied) * min(1.0, step_s / 0.5)
        shown = max(0.0, applied + random.gauss(0, 2.0))
        area_ha += _SPEED_MPS * step_s * _WIDTH_M / 10_000
        kg += applied * _SPEED_MPS * step_s * _WIDTH_M / 10_000
        opening = applied * _WIDTH_M * _SPEED_MPS / 10_000 / (0.0055 * 70 / 60)
        heads = [ndvi + random.gauss(0, 0.012) for _head in range(6)]
        row = LogRow(
            time_s=round(time_s, 3),
            utc=(_BEGAN + timedelta(seconds=time_s))
            .isoformat(timespec="milliseconds")
            .replace("+00:00", "Z"),
            lat_deg=34.8 + north / 111_200,
            lon_deg=113.6 + east / 91_300,
            fix_quality=4,
            satellites=18,
            hdop=0.7,
            heading_deg=heading,
            speed_mps=_SPEED_MPS + random.gauss(0, 0.02),
            wheel_speed_mps=_SPEED_MPS,
            speed_used_mps=_SPEED_MPS + random.gauss(0, 0.01),
            ndvi_1=heads[0],
            ndvi_2=heads[1],
            ndvi_3=heads[2],
            ndvi_4=heads[3],
            ndvi_5=heads[4],
            ndvi_6=heads[5],
            ndvi=ndvi,
            target_rate_kg_ha=target,
            nudge_percent=0.0,
            shaft_rpm_cmd=70.0,
            shaft_rpm=70.0 + random.gauss(0, 0.3),
            opening_mm_cmd=round(opening, 1),
            opening_mm=opening + random.gauss(0, 0.05),
            hopper_kg=300.0 - kg,
            flow_trim=1.012,
            supply_v=13.4,
            applied_rate_kg_ha=shown,
            lag_s=1.648,
            lag_m=1.648 * _SPEED_MPS,
            state="working",
            strategy="opening_first",
            target_source="canopy",
            alarms=";".join(alarm.id for alarm in alarms),
        )
        worked.add_tick(step_s, _SPEED_MPS, applied, target)
        used_kg_m = max(1e-6, applied * _WIDTH_M / 10_000)
        frames.append(
            Frame(
                seq=index,
                at_s=time_s,
                row=row,
                alarms=alarms,
                metres_left_m=round((300.0 - kg) / used_kg_m, -1),
                area_ha=area_ha,
                applied_kg=kg,
                gnss_age_s=0.08,
                gnss_hz=10.0,
                job="demonstration",
                machine="huanghai",
                crop="winter wheat",
                log_path="run.csv",
                simulated=True,
                place_m=(east, north),
                devices=tuple(
                    DeviceView(name, f"sim://{name}", name, True, 0.05, 10.0, index, 0)
                    for name in ("gnss", "heads", "board")
                ),
                totals=worked.make_totals()._replace(
                    covered_ha=0.97 * area_ha, overlap_ha=0.03 * area_ha
                ),
                effort=EffortFinding(
                    mean=58.0 + random.gauss(0, 0.2), should=57.5, low=53.0, high=62.0, unit="%"
                ),
                tally=JobCounts(48.0, index // 20, REFILLS, "", "2026-03-18T06:12:00Z"),
            )
        )
    return frames


def sample_alarms(at_s: float) -> tuple[Alarm, ...]:
    """One red and one amber alarm, 35 s and 12 s old."""
    return (
        Alarm("shaft_silent", Severity.RED, at_s - 35.0),
        Alarm(
            "hopper_low",
            Severity.AMBER,
            at_s - 12.0,
            False,
            (("hopper_kg", 18.5), ("metres_left", 640.0)),
        ),
    )


def sample_field() -> FieldPicture:
    """A field of five corners with planned rates, somewhat more than the made-up run covers."""
    corners = ((-4.0, -5.0), (58.0, -7.0), (62.0, 52.0), (46.0, 77.0), (-4.0, 75.0))
    rates = [
        [
            _rate(_ndvi(column * 3.0 - 2.5, row * 3.0 - 5.5))
            if _inside(corners, column * 3.0 - 2.5, row * 3.0 - 5.5)
            else float("nan")
            for column in range(23)
        ]
        for row in range(28)
    ]
    area_m2 = 0.5 * abs(
        sum(
            a[0] * b[1] - b[0] * a[1]
            for a, b in zip(corners, (*corners[1:], corners[0]), strict=True)
        )
    )
    return FieldPicture(
        "",
        (corners,),
        area_m2 / 10_000.0,
        _WIDTH_M,
        PlannedRates(-4.0, -7.0, 3.0, np.array(rates, dtype=np.float32)),
    )


class SampleLayers:
    """`console.app.pages.map.service.OverlayFiles`: one file that was applied crosswise, and one
    that is none."""

    def list_layer_files(self, running_log: str) -> tuple[LogFile, ...]:
        return (
            LogFile("/logs/autumn.geojson", "autumn.geojson", "2025-10-02 17:20", "0.4 MB"),
            LogFile("/logs/zones.geojson", "zones.geojson", "2025-09-30 08:05", "12.0 kB"),
        )

    def make_overlay(self, path: str, frame: Frame) -> OverlayFile:
        if not path.endswith("autumn.geojson"):
            raise ValueError("zones.geojson: shapes of type Polygon: allowed Point")
        worked = WorkedGround(6.0)
        for lap in range(11):
            worked.add_spots(
                [
                    OutletSpot(
                        60.0 * along,
                        6.0 * lap,
                        90.0,
                        220.0 + 12.0 * lap + 40.0 * along,
                        300.0,
                        float("nan"),
                    )
                    for along in (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9)
                ]
            )
        return OverlayFile(
            "autumn.geojson", worked, frozenset({MapLayer.APPLIED, MapLayer.TARGET, MapLayer.ERROR})
        )


def _inside(corners: tuple[tuple[float, float], ...], east_m: float, north_m: float) -> bool:
    """Inside a convex outline whose corners run against the clock."""
    return all(
        (b[0] - a[0]) * (north_m - a[1]) >= (b[1] - a[1]) * (east_m - a[0])
        for a, b in zip(corners, (*corners[1:], corners[0]), strict=True)
    )


def sample_services() -> Services:
    """What the screens' pictures are given: made-up answers, the same every time."""
    settings = SettingsStore(
        Settings(theme="night", keymap={"mark": "b"}),
        lambda _settings: None,
        "~/.config/topdress/settings.yaml",
    )
    return Services(
        calibrate=sample_calibrate_job(),
        diagnosis=MadeUpDiagnosis(),
        field=lambda _frame: sample_field(),
        settings=settings,
        job=SampleJobService(),
        layers=SampleLayers(),
    )

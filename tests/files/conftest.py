"""What the tests of files share."""

from collections.abc import Callable

import pytest
from topdress.control.log_row import COLUMNS, LogRow


@pytest.fixture
def full_row() -> Callable[[float], LogRow]:
    """A row in which everything is known, moving north at 1.25 m/s."""

    def make(time_s: float) -> LogRow:
        tenth = int(time_s * 10 + 1e-6)
        given = LogRow(
            time_s=time_s,
            utc=f"2026-03-20T08:{tenth // 600:02d}:{tenth // 10 % 60:02d}.{tenth % 10}00Z",
            lat_deg=34.1 + 1.25 * time_s / 111_000,
            lon_deg=119.5,
            fix_quality=4,
            satellites=17,
            hdop=0.7,
            heading_deg=0.5,
            pitch_deg=0.1,
            roll_deg=-0.2,
            speed_mps=1.25,
            wheel_speed_mps=1.26,
            speed_used_mps=1.25,
            ndvi_1=0.5,
            ndvi_2=0.51,
            ndvi_3=0.52,
            ndvi_4=0.49,
            ndvi_5=0.48,
            ndvi_6=0.5,
            ndvi=0.5,
            target_rate_kg_ha=336.7,
            nudge_percent=0.0,
            shaft_rpm_cmd=70.0,
            shaft_rpm=69.9,
            opening_mm_cmd=25.1,
            opening_mm=25.2,
            hopper_kg=299.95,
            flow_trim=1.0,
            supply_v=13.5,
            applied_rate_kg_ha=330.0,
            lag_s=1.63,
            lag_m=2.04,
            state="working",
            strategy="opening_first",
            target_source="canopy",
            work_switch=1,
            alarms="rate_off",
            events="mark corner;refill 120",
            speed_told="0.0 0.5 0.0 1.25",
            ndre_1=0.4,
            ndre_2=0.41,
            ndre_3=0.42,
            ndre_4=0.39,
            ndre_5=0.38,
            ndre_6=0.4,
            ndre=0.4,
        )
        # newer columns
        return given._replace(**{name: 1.0 for name in COLUMNS if getattr(given, name) is None})

    return make

"""The log row of a tick: what the sensors said, as long as it holds, and what came of it."""
from __future__ import annotations

from control.log_row import GNSS_HOLDS_S, HEAD_COLUMNS, HOLDS_S, NDRE_COLUMNS, LogRow
from control.loop.moment import Choices, Decision, Metered, Moment
from control.orders import BY_CANOPY, Strategy, TargetSource
from control.readings import DriveCommand, Measurements, Reading, is_fresh
from control.safety import Verdict

HEAD_SILENT_S = HOLDS_S["ndvi_1"]
_COLUMNS = {"ndvi": (*HEAD_COLUMNS, "ndvi"), "ndre": (*NDRE_COLUMNS, "ndre")}


def log_row(begun_s: float, moment: Moment, decision: Decision, metered: Metered, verdict: Verdict,
            command: DriveCommand, choices: Choices, strategy: Strategy, heads: tuple[float | None, ...],
            decided_ndvi: float | None, events: list[str]) -> LogRow:
    """The row of one tick; times count from `begun_s`; heads: as `head_ndvi` has them. A GNSS place that was refused
    is left out."""
    m, sensed, holding = moment.m, moment.sensed, decision.holding
    total_s = decision.lag.total_s
    fix = m.gnss if sensed.gnss_age_s is not None and sensed.gnss_age_s <= GNSS_HOLDS_S else None
    placed = fix if sensed.refused_m is None else None
    ndvi = heads + (None,) * 6
    decided = decided_ndvi if choices.source in BY_CANOPY else None
    seen: dict[str, float | None] = dict(zip(_COLUMNS[m.canopy_index], (*ndvi[:6], decided), strict=True))
    return LogRow(
        **seen,  # type: ignore[arg-type]
        time_s=m.time_s - begun_s, utc=fix.utc if fix else None,
        lat_deg=placed.lat_deg if placed else None, lon_deg=placed.lon_deg if placed else None,
        fix_quality=placed.fix_quality if placed else None, satellites=fix.satellites if fix else None,
        hdop=fix.hdop if fix else None, heading_deg=fix.heading_deg if fix else None,
        pitch_deg=_held(m, "pitch_deg"), roll_deg=_held(m, "roll_deg"),
        speed_mps=fix.speed_mps if fix else None, wheel_speed_mps=_held(m, "wheel_speed_mps"),
        speed_used_mps=sensed.speed_mps,
        target_rate_kg_ha=None if holding.source is TargetSource.POINT else decision.planned_kg_ha,
        nudge_percent=choices.nudge_percent,
        shaft_rpm_cmd=command.shaft_rpm, shaft_rpm=_held(m, "shaft_rpm"),
        opening_mm_cmd=command.opening_mm, opening_mm=_held(m, "opening_mm"),
        hopper_kg=_held(m, "hopper_kg"), flow_trim=metered.trim, supply_v=_held(m, "supply_v"),
        applied_rate_kg_ha=metered.rate_kg_ha, lag_s=total_s,
        lag_m=None if sensed.speed_mps is None else sensed.speed_mps * total_s,
        state=verdict.state.value, strategy=strategy.value, target_source=holding.source.value,
        work_switch=None if m.work_switch is None else int(m.work_switch),
        alarms=";".join([alarm.id for alarm in verdict.alarms]) or None, events=";".join(events) or None,
        sections_cmd=";".join([str(int(on)) for on in command.valves]) or None)


def head_ndvi(m: Measurements) -> tuple[float | None, ...]:
    """What each head reads; None: silent."""
    return tuple(_fresh(r, m.time_s, HEAD_SILENT_S) for r in m.ndvi)


def _held(m: Measurements, column: str) -> float | None:
    """What the row holds of a sensor."""
    return _fresh(getattr(m, column), m.time_s, HOLDS_S[column])


def _fresh(reading: Reading | None, now_s: float, holds_s: float) -> float | None:
    return None if reading is None or not is_fresh(reading.time_s, now_s, holds_s) else reading.value

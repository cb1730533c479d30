"""What does the log row of a tick contain? The valid sensor readings, and the results of the
tick.
"""

from __future__ import annotations

from typing import Any

from topdress.control.log_row import GNSS_VALID_FOR_S, VALID_FOR_S, LogRow
from topdress.control.loop.tick_state import (
    MeasuredState,
    MeteredMaterial,
    OperatorChoices,
    TickDecision,
)
from topdress.control.orders import CANOPY_SOURCES, Strategy, TargetSource
from topdress.control.readings import (
    SENSED_COLUMNS,
    DriveCommand,
    Measurements,
    find_valid_value,
)
from topdress.control.safety import SafetyVerdict

# Columns that hold the newest reading of a sensor, with the time for which they hold it.
_SENSED_VALID_FOR_S: tuple[tuple[Any, float], ...] = tuple(
    (name, VALID_FOR_S[name]) for name in SENSED_COLUMNS
)
# A head that is silent for longer counts as missing in the row.
# Empty cells for six heads and their decided NDVI.
_SILENT_CELLS = (None,) * 7


def make_log_row(
    started_s: float,
    moment: MeasuredState,
    *,
    decision: TickDecision,
    metered: MeteredMaterial,
    verdict: SafetyVerdict,
    command: DriveCommand,
    choices: OperatorChoices,
    strategy: Strategy,
    heads: tuple[float | None, ...],
    decided_ndvi: float | None,
    events: list[str],
    speed_told: str | None,
) -> LogRow:
    """Returns the row of one tick; times count from `started_s`; heads: index of each head.
    A refused GNSS position is left out."""
    m, sensed, holding, now_s = moment.m, moment.sensed, decision.holding, moment.m.time_s
    total_s = decision.lag.total_s
    # An old fix stays in the measurements; the row must not repeat it as new.
    fix = (
        m.gnss if sensed.gnss_age_s is not None and sensed.gnss_age_s <= GNSS_VALID_FOR_S else None
    )
    placed = fix if sensed.refused_m is None else None
    # The decided NDVI means nothing while another source sets the rate.
    decided = decided_ndvi if choices.source in CANOPY_SOURCES else None
    # Seven empty cells fill the columns of machines with fewer heads.
    seen = (*(*heads, *_SILENT_CELLS)[:6], decided)
    # A head reads one index; the columns of the other index stay empty.
    ndvi, ndre = (seen, _SILENT_CELLS) if m.canopy_index == "ndvi" else (_SILENT_CELLS, seen)
    return LogRow(
        time_s=now_s - started_s,
        utc=fix.utc if fix else None,
        lat_deg=placed.lat_deg if placed else None,
        lon_deg=placed.lon_deg if placed else None,
        fix_quality=placed.fix_quality if placed else None,
        satellites=fix.satellites if fix else None,
        hdop=fix.hdop if fix else None,
        heading_deg=fix.heading_deg if fix else None,
        speed_mps=fix.speed_mps if fix else None,
        speed_used_mps=sensed.speed_mps,
        ndvi_1=ndvi[0],
        ndvi_2=ndvi[1],
        ndvi_3=ndvi[2],
        ndvi_4=ndvi[3],
        ndvi_5=ndvi[4],
        ndvi_6=ndvi[5],
        ndvi=ndvi[6],
        target_rate_kg_ha=None if holding.source is TargetSource.POINT else decision.planned_kg_ha,
        nudge_percent=choices.nudge_percent,
        shaft_rpm_cmd=command.shaft_rpm,
        opening_mm_cmd=command.opening_mm,
        flow_trim=metered.trim,
        applied_rate_kg_ha=metered.rate_kg_ha,
        lag_s=total_s,
        lag_m=None if sensed.speed_mps is None else sensed.speed_mps * total_s,
        state=verdict.state.value,
        strategy=strategy.value,
        target_source=holding.source.value,
        work_switch=None if m.work_switch is None else int(m.work_switch),
        alarms=";".join([alarm.id for alarm in verdict.alarms]) or None,
        events=";".join(events) or None,
        speed_told=speed_told,
        ndre_1=ndre[0],
        ndre_2=ndre[1],
        ndre_3=ndre[2],
        ndre_4=ndre[3],
        ndre_5=ndre[4],
        ndre_6=ndre[5],
        ndre=ndre[6],
        sections_cmd=";".join([str(int(on)) for on in command.valves]) or None,
        **{
            name: find_valid_value(getattr(m, name), now_s, valid_s)
            for name, valid_s in _SENSED_VALID_FOR_S
        },
    )


def read_head_ndvi(m: Measurements) -> tuple[float | None, ...]:
    """Returns the reading of each head; None for a silent head."""
    return tuple([find_valid_value(r, m.time_s, VALID_FOR_S["ndvi_1"]) for r in m.ndvi])

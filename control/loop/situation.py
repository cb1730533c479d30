"""Which facts of a tick does safety need?"""

from __future__ import annotations

from topdress.control.loop.canopy_heads import CanopyHeads
from topdress.control.loop.tick_state import (
    MeasuredState,
    MeteredMaterial,
    OperatorChoices,
    TickDecision,
)
from topdress.control.orders import CANOPY_SOURCES, TargetSource
from topdress.control.readings import EffortFinding, RangeBreach, ScaleFinding
from topdress.control.safety import PreviousCommands, SafetySituation
from topdress.control.targets.external_target import ExternalTarget


def make_situation(
    moment: MeasuredState,
    decision: TickDecision,
    metered: MeteredMaterial,
    choices: OperatorChoices,
    *,
    heads: CanopyHeads,
    between_doses: bool,
    console_age_s: float | None,
    log_ok: bool,
    commanded: PreviousCommands,
    map_elsewhere: bool,
    scale: ScaleFinding,
    effort: EffortFinding,
    outside_target: ExternalTarget,
    range_breach: RangeBreach | None,
) -> SafetySituation:
    """Returns the situation of this tick. `between_doses`: rates are meaningless between doses,
    and left out."""
    m, sensed = moment.m, moment.sensed
    needs_heads = choices.source in CANOPY_SOURCES
    heard = [r.time_s for r in m.ndvi if r is not None] if needs_heads else []
    applied = (
        None if between_doses or metered.rate_kg_ha is None else metered.rate_kg_ha * metered.trim
    )
    return SafetySituation(
        measurements=m,
        speed_used_mps=sensed.speed_mps,
        gnss_period_s=sensed.gnss_period_s,
        wheel_standstill=sensed.wheel_standstill,
        target_source=choices.source,
        position_ok=sensed.position_ok,
        course_awaited=sensed.course_awaited,
        speed_doubt=sensed.doubt,
        landing_inside=decision.inside,
        valid_heads=heads.valid_heads if needs_heads else None,
        by_index_map=needs_heads and heads.by_map,
        ndvi_age_s=sensed.time_s - max(heard) if heard else None,
        expected_rate_kg_ha=None if between_doses else metered.expected_rate_kg_ha,
        applied_rate_kg_ha=applied,
        target_rate_kg_ha=decision.rate_kg_ha,
        metres_left_m=metered.metres_left_m,
        usable_speed_mps=decision.usable_mps if moment.speed_mps > decision.usable_mps else None,
        console_age_s=console_age_s,
        log_ok=log_ok,
        position_refused_m=sensed.refused_m,
        position_walks=sensed.walks,
        cut_from_kg_ha=decision.planned_kg_ha
        if decision.planned_kg_ha > decision.rate_kg_ha and not decision.by_point
        else None,
        commanded=commanded,
        map_elsewhere=map_elsewhere,
        scale=scale,
        silent_rate_kg_ha=outside_target.silent_rate_kg_ha
        if choices.source is TargetSource.EXTERNAL and not outside_target.speaks
        else None,
        effort=effort,
        range_breach=range_breach,
    )

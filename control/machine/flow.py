"""How much material flows from all outlets together, kg/s, at a true shaft speed and opening?
The hopper empties accordingly.
"""

from __future__ import annotations

from math import floor, pi, sin
from typing import Annotated, NamedTuple

from pydantic import Field

from .effect import FULL_FLOW, FULL_REVOLUTION, Effect

# Length of the time slots in which a bridge exists or not, s.
BRIDGE_SLOT_S = 12.0
# Speed below which the shaft stands, r/min; standing rollers do not carry the leaking material.
STANDSTILL_RPM = 0.5


class Flow(NamedTuple):
    """Parameters of the flow and of its effects."""

    grams_per_rev_mm: Annotated[float, Field(ge=1e-4, le=1000)] = 5.5
    flutes: Annotated[float, Field(ge=1, le=100)] = 6.0
    outlets: Annotated[float, Field(ge=1, le=100)] = 6.0
    full_kg: Annotated[float, Field(ge=0.01, le=20000)] = 300.0
    # Shaft speed at which the fall-off is defined, r/min.
    full_rpm: Annotated[float, Field(ge=0.1, le=1e4)] = 100.0
    gain_percent: Annotated[
        float,
        Field(ge=-60, le=100),
        Effect(
            "flow.gain",
            "%",
            "Kilograms per revolution off by a factor",
            "Another bulk density or product fills the flutes with another mass.",
            "product and density: 5-50 %",
            ("run", "catch", "weigh"),
            "Do a catch test with this product.",
            "A static weigh tells it from the scale, two openings from an offset.",
            says=(
                "The machine spreads {size} % more than it reckons.",
                "The machine spreads {size} % less than it reckons.",
            ),
        ),
    ] = 0.0
    zero_offset_g_rev: Annotated[
        float,
        Field(ge=-1e5, le=1e5),
        Effect(
            "flow.zero_offset",
            "g per revolution",
            "Material flows at zero opening, or needs some opening to start",
            "The rollers carry material past a closed gate, or the gate must open a little "
            "before any passes.",
            "an offset near 8 g per revolution is published",
            ("run", "catch"),
            "Catch test at two openings; renew the gate's brush or seal.",
            "Two openings at one shaft speed.",
            bounds=(-60.0, 60.0),
            scales_with=FULL_REVOLUTION,
            says=(
                "{size} g more than reckoned leave with every turn of the rollers, even "
                "with the gate shut.",
                "{size} g less than reckoned leave with every turn of the rollers: the gate "
                "must open some way "
                "before anything flows.",
            ),
        ),
    ] = 0.0
    fill_falloff_percent: Annotated[
        float,
        Field(ge=-10, le=60),
        Effect(
            "flow.fill_falloff",
            "% lost at {flow.full_rpm:g} r/min",
            "Flutes fill less at high shaft speed",
            "A flute that passes quickly under the hopper has no time to fill.",
            "3-15 % above 60 r/min are published",
            ("run", "catch"),
            "Work at a larger opening and a lower shaft speed.",
            "A staircase of shaft speeds at one opening.",
            says=(
                "At 100 r/min the rollers fill {size} % less than they should: fast driving "
                "gets too little.",
                "At 100 r/min the rollers give {size} % more than reckoned: fast driving "
                "gets too much.",
            ),
        ),
    ] = 0.0
    hopper_head_percent: Annotated[
        float,
        Field(ge=0, le=40),
        Effect(
            "flow.hopper_head",
            "% lost from full to empty",
            "Flows less as the hopper empties",
            "Less material above the rollers presses less into the flutes.",
            "1-3 % are published",
            ("run",),
            "Refill earlier, or let the scale correct the flow.",
            "A refill half-way: the head jumps back, time does not.",
            says=("From a full to an empty hopper the flow falls by {size} %.",),
        ),
    ] = 0.0
    moisture_percent_per_h: Annotated[
        float,
        Field(ge=-30, le=30),
        Effect(
            "flow.moisture_drift",
            "% per hour",
            "Flow changes with elapsed time",
            "Caking or humid air change how the granules flow as the day goes on.",
            "hygroscopic urea",
            ("run",),
            "Cover the hopper; catch test at noon.",
            "A refill half-way: the drift goes on, the hopper's head does not.",
            says=(
                "The flow grows by {size} % every hour.",
                "The flow falls by {size} % every hour.",
            ),
        ),
    ] = 0.0
    batch_percent: Annotated[
        float,
        Field(ge=-60, le=100),
        Effect(
            "flow.batch",
            "%",
            "Flow steps at a refill",
            "The lot that was filled in has another density or grain size.",
            "product lots",
            ("run",),
            "Catch test after every change of lot.",
            "Two refills from different lots.",
            says=(
                "After a refill {size} % more flows than before it.",
                "After a refill {size} % less flows than before it.",
            ),
        ),
    ] = 0.0
    blocked_percent: Annotated[
        float,
        Field(ge=0, le=100),
        Effect(
            "flow.blocked_outlet",
            "% lost",
            "One or more outlets close at some time",
            "A clod or wet material closes a tube, and that outlet's share is missing.",
            "one of six outlets: 16.7 %",
            ("run",),
            "Look at the outlets, clear the tube.",
            "Catch test by outlet.",
            probes=(100.0 / 6.0,),
            says=("A blocked outlet costs {size} % of the flow.",),
        ),
    ] = 0.0
    uneven_percent: Annotated[
        float,
        Field(ge=-100, le=100),
        Effect(
            "flow.outlet_uneven",
            "%",
            "One outlet gives more or less than its share",
            "A worn roller or a bent tube changes one outlet alone.",
            "outlet uniformity tests",
            ("catch",),
            "Set or change that outlet's roller.",
            "Catch test by outlet.",
            member_field="uneven_outlet",
            says=(
                "One outlet gives {size} % more than its share.",
                "One outlet gives {size} % less than its share.",
            ),
        ),
    ] = 0.0
    uneven_outlet: Annotated[float, Field(ge=0, le=100)] = 0.0
    bridging_percent: Annotated[
        float,
        Field(ge=0, le=90),
        Effect(
            "flow.bridging",
            "% of time",
            "Flow stops for spells while the shaft turns",
            "Damp material arches over the rollers until a bump breaks the arch.",
            "field experience with damp urea",
            ("run",),
            "Switch the agitator on; break lumps when filling.",
            "Watch the scale while the shaft turns at one speed.",
            probes=(10.0,),
            says=("For {size} % of the time nothing flows though the shaft turns.",),
        ),
    ] = 0.0
    leak_kg_h: Annotated[
        float,
        Field(ge=0, le=1e5),
        Effect(
            "flow.leak",
            "kg/h",
            "Material flows with the shaft stopped",
            "A worn gate or roller lets material trickle when nothing should.",
            "worn seals",
            ("run",),
            "Renew the gate's seal or brush.",
            "Stand still with the shaft stopped and watch the scale.",
            probes=(1.0,),
            bounds=(0.0, 500.0),
            scales_with=FULL_FLOW,
            says=("{size} kg an hour leak out with the shaft stopped.",),
        ),
    ] = 0.0
    slope_percent_per_deg: Annotated[
        float,
        Field(ge=-5, le=5),
        Effect(
            "flow.slope",
            "% more per degree nose up",
            "Flow changes with pitch",
            "On a slope the material leans towards or away from the rollers.",
            "0.3-1 % per degree are published",
            ("run",),
            "Nothing to mend: the model compensates it.",
            "Out and back on a slope.",
            says=(
                "Each degree uphill adds {size} % to the flow.",
                "Each degree uphill takes {size} % off the flow.",
            ),
        ),
    ] = 0.0
    pulsation_percent: Annotated[
        float,
        Field(ge=0, le=100),
        Effect(
            "flow.pulsation",
            "% amplitude",
            "Flow is periodic in the shaft angle",
            "Each flute empties as a lump; at low speed the lumps lie apart on the ground.",
            "six flutes at 20 r/min pulse at 2 Hz",
            ("fast catch",),
            "Work at a higher shaft speed and a smaller opening; helical rollers.",
            "A fast catch (at least 20 samples a second) at a low shaft speed.",
            says=("The flow comes in pulses of {size} % with each turn of the rollers.",),
        ),
    ] = 0.0


class FlowInput(NamedTuple):
    """Inputs of the flow."""

    shaft_rpm: float
    opening_mm: float
    pitch_deg: float = 0.0
    # Mass refilled at the start of this step, kg.
    refill_kg: float = 0.0
    # Sum of the machine file's terms, %.
    more_percent: float = 0.0
    # Sum of the terms while the shaft turns, kg/s.
    more_kg_s: float = 0.0


class FlowState(NamedTuple):
    """State of the flow."""

    time_s: float
    hopper_kg: float
    angle_rev: float
    refills: float


class FlowOutput(NamedTuple):
    """Outputs of the flow."""

    # True flow, kg/s; only the scale measures it.
    flow_kg_s: float
    hopper_kg: float


def make_flow_start(hopper_kg: float, time_s: float = 0.0) -> FlowState:
    return FlowState(time_s, hopper_kg, 0.0, 0.0)


def is_bridged(time_s: float, percent_of_time: float) -> bool:
    """Returns whether a bridge exists at `time_s`: slots of BRIDGE_SLOT_S seconds, bridged in a
    fixed irregular pattern."""
    if percent_of_time <= 0.0:
        return False
    slot = floor(time_s / BRIDGE_SLOT_S)
    irregular = sin(slot * 12.9898) * 43758.5453
    return (irregular - floor(irregular)) * 100.0 < percent_of_time


def calc_grams_per_rev(p: Flow, shaft_rpm: float, opening_mm: float) -> float:
    """Returns the mass of a revolution in steady state on level ground with a full hopper, g.
    This part of the model is invertible."""
    speed = shaft_rpm / p.full_rpm
    lost = p.fill_falloff_percent * speed * speed * speed
    mass = p.grams_per_rev_mm * opening_mm * (1.0 + p.gain_percent / 100.0) + p.zero_offset_g_rev
    return mass * (1.0 - lost / 100.0) if mass > 0.0 else 0.0


def calc_common_factor(
    p: Flow,
    share_full: float,
    elapsed_s: float,
    pitch_deg: float,
    more_percent: float,
    refilled: bool,
) -> float:
    """Returns the factor on the flow that is independent of shaft and opening: hopper head, blocked
    outlets, drift, slope, lot, an uneven outlet.

    share_full: filled share of the hopper.
    """
    lost = p.hopper_head_percent * (1.0 - share_full) + p.blocked_percent
    more = p.moisture_percent_per_h * elapsed_s / 3600.0 + p.slope_percent_per_deg * pitch_deg
    more += more_percent
    if refilled:
        more += p.batch_percent
    if p.uneven_outlet > 0.0:
        more += p.uneven_percent / p.outlets
    return (1.0 - lost / 100.0) * (1.0 + more / 100.0)


def calc_flute_load(
    p: Flow,
    shaft_rpm: float,
    opening_mm: float,
    pitch_deg: float,
    share_full: float,
    elapsed_s: float,
    more_percent: float,
    refilled: bool,
) -> tuple[float, float]:
    """Returns the load of the rollers, g per revolution: the moved mass, and the mass packed
    before closed outlets."""
    if share_full <= 0.0 or (
        p.bridging_percent > 0.0 and is_bridged(elapsed_s, p.bridging_percent)
    ):
        return 0.0, 0.0
    mass = calc_grams_per_rev(p, shaft_rpm, opening_mm)
    moved = mass * calc_common_factor(p, share_full, elapsed_s, pitch_deg, more_percent, refilled)
    return moved, mass * p.blocked_percent / 100.0


def step_flow(p: Flow, s: FlowState, u: FlowInput, dt_s: float) -> tuple[FlowState, FlowOutput]:
    """Advances the flow by one step of `dt_s` with constant inputs; the output flow is the mean
    over the step. Mass is conserved.

    Nominal: q = 0.0055 x opening_mm x shaft_rpm / 60 kg/s.
    """
    hopper, refills = s.hopper_kg + u.refill_kg, s.refills
    if hopper > p.full_kg:
        hopper = p.full_kg
    if u.refill_kg > 0.0:
        refills += 1.0
    flow = calc_grams_per_rev(p, u.shaft_rpm, u.opening_mm) * u.shaft_rpm / 60_000.0
    flow *= calc_common_factor(
        p, hopper / p.full_kg, s.time_s, u.pitch_deg, u.more_percent, refills > 0.0
    )
    if p.pulsation_percent != 0.0:
        flow *= 1.0 + p.pulsation_percent / 100.0 * sin(2.0 * pi * p.flutes * s.angle_rev)
    if u.shaft_rpm >= STANDSTILL_RPM:
        flow += u.more_kg_s
    if not flow > 0.0 or (p.bridging_percent > 0.0 and is_bridged(s.time_s, p.bridging_percent)):
        flow = 0.0
    if u.shaft_rpm < STANDSTILL_RPM:
        flow += p.leak_kg_h / 3600.0
    if flow > hopper / dt_s:
        flow = hopper / dt_s
    hopper -= flow * dt_s
    angle = s.angle_rev + u.shaft_rpm / 60.0 * dt_s
    return FlowState(s.time_s + dt_s, hopper, angle - floor(angle), refills), FlowOutput(
        flow, hopper
    )

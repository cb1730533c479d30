"""How does the metering gate follow its command? The model maps the command, mm, to true opening
and displacement reading: dead time, slew rate, backlash, lost steps.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from pydantic import Field

from .effect import OPENING_RANGE, SLEW_RATE, Effect
from .model_elements import DelayLine, make_line, put_in_line, read_held_line


class Gate(NamedTuple):
    """Parameters of the gate and of its effects."""

    dead_time_s: Annotated[float, Field(ge=0, le=5)] = 0.10
    slew_mm_s: Annotated[float, Field(ge=0.1, le=500)] = 20.0
    full_mm: Annotated[float, Field(ge=0.1, le=500)] = 60.0
    offset_mm: Annotated[
        float,
        Field(ge=-500, le=500),
        Effect(
            "gate.offset",
            "mm, reading - true",
            "Gate sensor reads too wide or too narrow, always by the same",
            "A shifted displacement sensor reports a wrong opening, and the flow follows "
            "the true one.",
            "sensor mounting; usual 0.2-3 mm",
            ("run",),
            "Close the gate against its stop and set the sensor's zero.",
            "Home the gate, then weigh at two openings.",
            bounds=(-20.0, 20.0),
            scales_with=OPENING_RANGE,
            says=(
                "The gate opens {size} mm less than it reads.",
                "The gate opens {size} mm more than it reads.",
            ),
        ),
    ] = 0.0
    home_error_mm: Annotated[
        float,
        Field(ge=-500, le=500),
        Effect(
            "gate.home_error",
            "mm, true - command",
            "Gate stands too wide or too narrow, always by the same",
            "The stepper was homed in the wrong place, and every position is off by the "
            "same amount.",
            "home switch; usual 0.2-3 mm",
            ("run",),
            "Home the gate again; check the home switch.",
            "Compare the command with the displacement sensor at two openings.",
            bounds=(-20.0, 20.0),
            scales_with=OPENING_RANGE,
            says=(
                "The gate opens {size} mm more than commanded.",
                "The gate opens {size} mm less than commanded.",
            ),
        ),
    ] = 0.0
    backlash_mm: Annotated[
        float,
        Field(ge=0, le=500),
        Effect(
            "gate.backlash",
            "mm",
            "Play between opening and closing moves",
            "Worn screw and nut turn without moving the gate when the direction changes.",
            "lead screw wear; usual 0.2-2 mm",
            ("run",),
            "Renew the nut or preload it with a spring.",
            "Approach the same openings from below and from above.",
            probes=(0.2, 0.5, 1.0, 2.0, 4.0),
            bounds=(0.0, 15.0),
            scales_with=OPENING_RANGE,
            says=("The gate has {size} mm of play between opening and closing.",),
        ),
    ] = 0.0
    lost_mm_per_100mm: Annotated[
        float,
        Field(ge=-5, le=5),
        Effect(
            "gate.lost_steps",
            "mm per 100 mm",
            "Opening falls behind with the distance moved",
            "A stepper that skips steps under load stands a little more closed after every move.",
            "stepper under load; found by comparing with the displacement sensor",
            ("run",),
            "Lower the stepper's speed, raise its current, clean the slide; home more often.",
            "Move often at one mean opening, then home.",
            probes=(0.05,),
            says=(
                "The gate falls behind by {size} mm for every 100 mm that it moves.",
                "The gate runs ahead by {size} mm for every 100 mm that it moves.",
            ),
        ),
    ] = 0.0
    slow_mm_s: Annotated[
        float,
        Field(ge=-500, le=500),
        Effect(
            "gate.slow",
            "mm/s lost",
            "Gate moves too slowly",
            "A sticky slide or a lowered pulse rate makes every move take longer.",
            "slide friction",
            ("run",),
            "Clean and grease the slide; check the pulse rate.",
            "Large steps of the opening both ways.",
            probes=(0.5,),
            bounds=(-20.0, 19.5),
            scales_with=SLEW_RATE,
            says=(
                "The gate moves {size} mm/s slower than it should.",
                "The gate moves {size} mm/s faster than it should.",
            ),
        ),
    ] = 0.0
    stuck: Annotated[
        float,
        Field(ge=0, le=1),
        Effect(
            "gate.stuck",
            "s",
            "Gate stops moving at some time",
            "A jammed slide or a dead driver leaves the gate where it is.",
            "field experience",
            ("run",),
            "Switch off, free the slide, check driver and cable.",
            "None needed: command moves, read-back does not.",
            probes=(1.0,),
            onset_only=True,
            says=("The gate stopped moving {size} s into the run.",),
        ),
    ] = 0.0


class GateInput(NamedTuple):
    """Inputs of the gate."""

    command_mm: float
    # Sum of the machine file's terms, mm.
    more_mm: float = 0.0


class GateState(NamedTuple):
    """State of the gate."""

    time_s: float
    # Position by the count of the stepper motor, mm.
    driven_mm: float
    # Position of the gate behind the backlash, mm.
    carried_mm: float
    travelled_mm: float
    line: DelayLine


class GateOutput(NamedTuple):
    """Outputs of the gate."""

    # True opening, mm.
    opening_mm: float
    measured_mm: float


def make_gate_start(opening_mm: float = 0.0, time_s: float = 0.0) -> GateState:
    """Returns a gate that stands at `opening_mm` under a constant command."""
    return GateState(time_s, opening_mm, opening_mm, 0.0, make_line(opening_mm))


def step_gate(p: Gate, s: GateState, u: GateInput, dt_s: float) -> tuple[GateState, GateOutput]:
    """Advances the gate by one step of `dt_s` with a constant command; the outputs are those at
    its end."""
    line = put_in_line(s.line, s.time_s, u.command_mm)
    slew = max(0.0, p.slew_mm_s - p.slow_mm_s) * (1.0 - p.stuck)
    half = 0.5 * p.backlash_mm
    driven, carried, travelled = s.driven_mm, s.carried_mm, s.travelled_mm
    at_s, end_s = s.time_s - p.dead_time_s, s.time_s - p.dead_time_s + dt_s
    while at_s < end_s:
        line, wanted, until_s = read_held_line(line, at_s, end_s)
        most = slew * (until_s - at_s)
        move = wanted - driven
        if move > most:
            move = most
        elif move < -most:
            move = -most
        driven += move
        travelled += abs(move)
        if carried < driven - half:
            carried = driven - half
        if carried > driven + half:
            carried = driven + half
        at_s = until_s
    true = carried + p.home_error_mm - p.lost_mm_per_100mm * travelled / 100.0
    true = min(p.full_mm, max(0.0, true + u.more_mm))
    return GateState(s.time_s + dt_s, driven, carried, travelled, line), GateOutput(
        true, true + p.offset_mm
    )

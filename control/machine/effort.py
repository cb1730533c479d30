"""How hard do shaft and gate drives work, from speed, acceleration, material and supply?

A control loop hides friction, load and blockage: the speed is correct, but the motor works harder.
The model is linear in its parameters. Its unit is the machine file's `effort_unit`; a drive without
parameters has no effort.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from pydantic import Field

from .effect import Effect

# Number in the effort's unit.
EffortNumber = Annotated[float, Field(ge=0, le=1000)]


class Effort(NamedTuple):
    """Parameters of the effort of the metering shaft, and with `gate_` of the gate. A standing
    drive has no effort."""

    # Dry friction in forward rotation, at any speed.
    coulomb: EffortNumber = 0.0
    # Dry friction in reverse rotation.
    coulomb_back: EffortNumber = 0.0
    # Viscous friction for each r/min forwards.
    viscous: EffortNumber = 0.0
    # Viscous friction for each r/min backwards.
    viscous_back: EffortNumber = 0.0
    # Effort for each r/min per second of acceleration.
    inertia: EffortNumber = 0.0
    # Effort for each gram per revolution that the flutes move.
    load: EffortNumber = 0.0
    # Load factor of material packed before a closed outlet, as a multiple of `load`. The value is
    # an estimate: granules in a closed duct bear several times their weight, and nobody has
    # measured the factor.
    jam: Annotated[float, Field(ge=0, le=100)] = 5.0
    # 1 for a duty cycle, which grows as the supply voltage falls.
    by_supply: Annotated[float, Field(ge=0, le=1)] = 0.0
    # Maximum effort of the drive; 0 means unknown.
    limit: EffortNumber = 0.0
    gate_coulomb: EffortNumber = 0.0
    gate_coulomb_back: EffortNumber = 0.0
    # Viscous friction of the gate for each mm/s.
    gate_viscous: EffortNumber = 0.0
    gate_viscous_back: EffortNumber = 0.0
    # Effort of the gate for each mm/s per second.
    gate_inertia: EffortNumber = 0.0
    gate_limit: EffortNumber = 0.0
    friction_percent: Annotated[
        float,
        Field(ge=0, le=500),
        Effect(
            "effort.friction",
            "% more than its own",
            "Metering drive works against more friction",
            "Bearings and seals that run dry, or grind, take the same more at every speed; "
            "the loop holds the speed.",
            "ball screw without lubricant: 13-15 % more current (Cranfield, doi "
            "10.17862/cranfield.rd.5097649)",
            ("run",),
            "Grease the shaft's bearings and gear; turn it by hand with the drive off.",
            "An empty hopper, slow and fast: material plays no part, friction is the same at both.",
            says=(
                "The metering drive works against {size} % more friction than when it was sound.",
            ),
        ),
    ] = 0.0
    drag_percent: Annotated[
        float,
        Field(ge=-90, le=500),
        Effect(
            "effort.drag",
            "% more than its own",
            "Metering drive works harder the faster it turns",
            "Stiff grease in the cold, or a worn motor, takes more the faster the shaft turns.",
            "greases stiffen two- to tenfold from 20 to -10 degrees C (NLGI 2 data sheets)",
            ("run",),
            "Let the drive warm up; use a softer grease.",
            "An empty hopper, slow and fast: drag grows with the speed.",
            says=(
                "The metering drive works {size} % harder with its speed than when it was sound.",
                "The metering drive works {size} % easier with its speed than when it was "
                "calibrated.",
            ),
        ),
    ] = 0.0
    load_percent: Annotated[
        float,
        Field(ge=-100, le=500),
        Effect(
            "effort.load",
            "% more of the material's load",
            "Material loads the metering drive otherwise",
            "Empty or bridged flutes turn easily; packed ones, before a closed outlet, or "
            "wet product turn hard.",
            "a roller that turns empty takes none of it",
            ("run",),
            "Less: look for a bridge, or an empty hopper. More: look for a blocked outlet, "
            "stones, clods, wet product.",
            "Catch test by outlet: one that gives less than the others is blocked. All give "
            "alike: two openings at one "
            "shaft speed; the load goes with the material, friction does not.",
            says=(
                "The material in the rollers loads the drive {size} % more than it should: "
                "blocked, or wet?",
                "The material in the rollers loads the drive {size} % less than it should: "
                "bridged, or empty?",
            ),
        ),
    ] = 0.0
    gate_friction_percent: Annotated[
        float,
        Field(ge=0, le=500),
        Effect(
            "effort.gate_friction",
            "% more than its own",
            "Gate's drive works against more friction",
            "A spindle without lubricant, or a gate that scrapes, takes the same more at "
            "every speed.",
            "ball screw without lubricant: 13-15 % more current (Cranfield, doi "
            "10.17862/cranfield.rd.5097649)",
            ("run",),
            "Clean and grease the gate's spindle and guides.",
            "Move the gate slow and fast, empty: friction is the same at both.",
            says=("The gate's drive works against {size} % more friction than when it was sound.",),
        ),
    ] = 0.0
    gate_drag_percent: Annotated[
        float,
        Field(ge=-90, le=500),
        Effect(
            "effort.gate_drag",
            "% more than its own",
            "Gate's drive works harder the faster it moves",
            "Stiff grease takes more the faster the gate moves.",
            "greases stiffen two- to tenfold from 20 to -10 degrees C (NLGI 2 data sheets)",
            ("run",),
            "Let the drive warm up; use a softer grease.",
            "Move the gate slow and fast: drag grows with the speed.",
            says=(
                "The gate's drive works {size} % harder with its speed than when it was sound.",
                "The gate's drive works {size} % easier with its speed than when it was "
                "calibrated.",
            ),
        ),
    ] = 0.0


# A run of a healthy machine determines these parameters; a later run may differ within the
# tolerance.
SHAFT_EFFORT_PARTS = ("coulomb", "coulomb_back", "viscous", "viscous_back", "load")
GATE_EFFORT_PARTS = ("gate_coulomb", "gate_coulomb_back", "gate_viscous", "gate_viscous_back")


# Components of an effort: dry friction, viscous friction, and acceleration.
EffortParts = tuple[float, float, float]


class EffortInput(NamedTuple):
    """Inputs of a drive's effort."""

    # Speed in r/min, or mm/s for the gate.
    speed: float
    speed_per_s: float = 0.0
    # Nominal supply voltage divided by the supply voltage.
    supply_share: float = 1.0
    # Mass that the flutes move in a revolution, g.
    grams_rev: float = 0.0
    # Mass that the flutes would move if no outlet were closed, g.
    packed_g_rev: float = 0.0


def calc_drive_parts(
    coulomb: float,
    coulomb_back: float,
    viscous: float,
    viscous_back: float,
    inertia: float,
    friction_percent: float,
    drag_percent: float,
    speed: float,
    speed_per_s: float,
) -> EffortParts:
    """Returns the components of a drive's own effort.

    Friction is the mean of both directions, because their difference is a load in one direction.
    """
    own = coulomb if coulomb_back <= 0.0 else 0.5 * (coulomb + coulomb_back)
    more = 0.01 * friction_percent * own
    if speed < 0.0:
        return (
            more + coulomb_back,
            -viscous_back * (1.0 + 0.01 * drag_percent) * speed,
            -inertia * speed_per_s,
        )
    return more + coulomb, viscous * (1.0 + 0.01 * drag_percent) * speed, inertia * speed_per_s


def calc_shaft_parts(p: Effort, u: EffortInput) -> tuple[float, float, float, float]:
    """Returns the components of a turning shaft's effort at the nominal supply: its own three,
    and the material's load."""
    friction, drag, gains = calc_drive_parts(
        p.coulomb,
        p.coulomb_back,
        p.viscous,
        p.viscous_back,
        p.inertia,
        p.friction_percent,
        p.drag_percent,
        u.speed,
        u.speed_per_s,
    )
    return (
        friction,
        drag,
        gains,
        p.load * (1.0 + 0.01 * p.load_percent) * (u.grams_rev + p.jam * u.packed_g_rev),
    )


def calc_supply_factor(p: Effort, u: EffortInput) -> float:
    """Returns the factor on the effort at the nominal supply."""
    return 1.0 + p.by_supply * (u.supply_share - 1.0)


def calc_shaft_effort(p: Effort, u: EffortInput) -> float:
    """Returns the effort of the metering shaft, before noise; 0 while it stands."""
    return (
        0.0 if u.speed == 0.0 else max(0.0, sum(calc_shaft_parts(p, u)) * calc_supply_factor(p, u))
    )


def calc_gate_effort(p: Effort, u: EffortInput) -> float:
    """Returns the effort of the gate, before noise; 0 while it stands."""
    return (
        0.0
        if u.speed == 0.0
        else max(
            0.0,
            calc_supply_factor(p, u)
            * sum(
                calc_drive_parts(
                    p.gate_coulomb,
                    p.gate_coulomb_back,
                    p.gate_viscous,
                    p.gate_viscous_back,
                    p.gate_inertia,
                    p.gate_friction_percent,
                    p.gate_drag_percent,
                    u.speed,
                    u.speed_per_s,
                )
            ),
        )
    )

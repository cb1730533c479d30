"""Which real machines may a machine file represent? Variants within its uncertain parameters, and a
calibrated machine after a season.

No table of the papers shows how granules fall in the tube (docs/decisions/0005), nor what the field
adds to the rig's lag. So control is never judged on the machine of its own file alone: every
strategy is measured on each variant.
"""

from __future__ import annotations

from collections.abc import Callable

from .machine import Machine, add_effect
from .start_lag import set_carried_share

# Amplitude of the sum of six outlets, %; a single straight-fluted roller has a larger amplitude.
PULSATION_PERCENT = 5.0
# Longest first-fill time of an empty tube, s.
FIRST_FILL_S = 0.86
# Additional lag of the field over the rig, s (lag paper, tables 1 and 4: 0.32 s at 4.50 km/h).
FIELD_LAG_S = 0.3
# Factor on all times of a slow drive, by cold grease or a weak supply.
SLOW_DRIVE_FACTOR = 1.2


def _make_slow_drives(machine: Machine) -> Machine:
    shaft, gate = machine.shaft, machine.gate
    shaft = shaft._replace(
        dead_time_s=SLOW_DRIVE_FACTOR * shaft.dead_time_s,
        time_constant_s=SLOW_DRIVE_FACTOR * shaft.time_constant_s,
        acceleration_rpm_s=shaft.acceleration_rpm_s / SLOW_DRIVE_FACTOR,
    )
    gate = gate._replace(
        dead_time_s=SLOW_DRIVE_FACTOR * gate.dead_time_s,
        slew_mm_s=gate.slew_mm_s / SLOW_DRIVE_FACTOR,
    )
    return machine.model_copy(update={"shaft": shaft, "gate": gate})


PLAUSIBLE_MACHINES: dict[str, Callable[[Machine], Machine]] = {
    "carried_along": lambda machine: set_carried_share(machine, 1.0),
    "singly": lambda machine: set_carried_share(machine, 0.0),
    "between": lambda machine: set_carried_share(machine, 0.5),
    # The additional time of a start may be the first fill of an empty tube, except for the free
    # fall from an outlet 0.5 m high: 0 to 0.86 s of the 1.18 to 1.75 s (docs/decisions/0005). The
    # variants use the middle and the end of this range.
    "first_fill_half": lambda machine: machine.model_copy(
        update={"fall": machine.fall._replace(start_more_s=0.5 * FIRST_FILL_S)}
    ),
    "first_fill_all": lambda machine: machine.model_copy(
        update={"fall": machine.fall._replace(start_more_s=FIRST_FILL_S)}
    ),
    "pulsating": lambda machine: add_effect(machine, "flow.pulsation", PULSATION_PERCENT),
    "flow_3_more": lambda machine: add_effect(machine, "flow.gain", 3.0),
    "flow_6_more": lambda machine: add_effect(machine, "flow.gain", 6.0),
    "field_lag": lambda machine: add_effect(machine, "lag.offset", FIELD_LAG_S),
    "slow_drives": _make_slow_drives,
    # An open-loop motor loses 7 % per volt (docs/safety.md): a worn battery.
    "motor_12_slow": lambda machine: add_effect(machine, "shaft.gain", -12.0),
    # The trims correct 2 mm of this error.
    "gate_4_short": lambda machine: add_effect(machine, "gate.home_error", -4.0),
}


def make_plausible_machine(machine: Machine, name: str) -> Machine:
    """Returns the variant of a machine with this name. Raises ValueError, in one line, for an
    unknown name."""
    if name not in PLAUSIBLE_MACHINES:
        raise ValueError(f"plausible machine {name!r}: allowed {', '.join(PLAUSIBLE_MACHINES)}")
    return PLAUSIBLE_MACHINES[name](machine)

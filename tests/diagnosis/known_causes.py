"""What is to come out of recordings of a real actuator whose cause is known
(../shared/data/known_causes).

Written down before anything of topdress was run on them. Ball screw, position loop, 25 Hz; the
reference of each load is the sound recording at that load; sizes in % of the effort that the
sound drive needs while it moves, from a straight-line model fitted to the sound recording (by
direction: Coulomb, viscous; inertia).
"""

from __future__ import annotations

from typing import NamedTuple


class Expected(NamedTuple):
    recording: str
    load_kgf: int
    cause: str  # "" : none
    percent: float = 0.0  # that the 90 % interval is to hold


EXPECTED = (
    *(Expected("normal", load, "") for load in (20, 40, -40)),
    Expected("lackLubrication1", 20, "friction", 13.3),
    Expected("lackLubrication1", 40, "friction", 14.5),
    Expected("lackLubrication1", -40, ""),  # not to be seen at this load, and said so
    *(Expected("backlash1", load, "") for load in (20, 40, -40)),  # anything but friction
)

"""Which terms of the machine file can control compensate, and what are their values in this
tick?
"""

from __future__ import annotations

from topdress.control.machine.machine import Machine
from topdress.control.machine.term_sums import (
    NO_TERMS,
    FrozenTerms,
    HeldCommands,
    TermSums,
    TermTotals,
    explain_not_compensated,
)
from topdress.control.machine.terms import VARIABLES, TermTarget
from topdress.control.readings import SENSED_COLUMNS, DriveCommand, Measurements, Reading
from topdress.control.sensing import SensedMotion

DRIVE_TARGETS = (TermTarget.SHAFT_PERCENT, TermTarget.SHAFT_RPM, TermTarget.GATE_MM)
SCALE_TARGETS = (TermTarget.SCALE_KG,)
_SENSED_VARIABLES = tuple(name for name in SENSED_COLUMNS if name in VARIABLES)


class KnownTerms:
    """Advances the terms once a tick. A term is left out while its reading is unknown."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._terms = TermSums(term for term in machine.terms if not explain_not_compensated(term))
        self._commands = HeldCommands(machine, 0.0, machine.set_points.opening_mm)
        self._ran_away_kg = 0.0
        self.now: FrozenTerms | None = None

    def advance_terms(
        self,
        m: Measurements,
        sensed: SensedMotion,
        since_s: float,
        command: DriveCommand | None,
        dt_s: float,
    ) -> None:
        """Advances the terms. `command`: in force until now; `since_s`: time since the run
        began, s."""
        # Most machine files have no term.
        if not self._terms:
            return
        values = {
            name: reading.value
            for name in _SENSED_VARIABLES
            # A sum over a missing reading would count it as zero.
            if (reading := getattr(m, name)) is not None
        }
        values |= {
            name: value
            for name, value in (
                ("speed_mps", sensed.speed_mps),
                ("heading_deg", sensed.heading_deg),
                ("time_s", since_s),
            )
            if value is not None
        }
        # The drives follow commands with a lag, so a term sees the mean command of the tick.
        if command is not None and dt_s > 0.0:
            values |= self._commands.average_commands(
                m.time_s - dt_s, command.shaft_rpm, command.opening_mm, dt_s
            )
        more = self._terms.advance_terms(values, dt_s)
        # A drift of the scale adds up, whereas other errors of the scale do not.
        self._ran_away_kg += more.scale_kg_min / 60.0 * dt_s
        self.now = self._terms.freeze_terms(values)

    @property
    def drive_errors(self) -> TermTotals:
        """Returns the errors of shaft and gate under their present commands."""
        return NO_TERMS if self.now is None else self.now.find_totals(DRIVE_TARGETS)

    def correct_weighing(self, scale: Reading | None) -> Reading | None:
        """Returns the scale's reading without the error of its terms."""
        if scale is None or self.now is None:
            return scale
        return scale._replace(
            value=scale.value - self.now.find_totals(SCALE_TARGETS).scale_kg - self._ran_away_kg
        )

"""What is the result of one tick?"""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.agronomy.reference_strips import ReferenceStrips
from topdress.control.log_row import LogRow
from topdress.control.loop.tick_state import OperatorChoices
from topdress.control.orders import Alarm, SectionState, TargetSource
from topdress.control.readings import DriveCommand, EffortFinding
from topdress.control.safety import POWERED_STATES, Allowances, BenchRun, SafetyVerdict
from topdress.control.sensing import SensedMotion
from topdress.control.targets.lag_correction import FiredChange


class Tick(NamedTuple):
    """Holds the results of the steps of a tick. Fields that the console's frame shows have the
    same name there."""

    row: LogRow
    command: DriveCommand
    sensed: SensedMotion
    verdict: SafetyVerdict
    choices: OperatorChoices
    allow: Allowances
    fired: tuple[FiredChange, ...]
    notes: tuple[str, ...]
    # Numbers of the ignored heads, from 1.
    dropped_heads: tuple[int, ...]
    # Reading of each head, left to right; None for a silent head.
    head_ndvi: tuple[float | None, ...]
    metres_left_m: float | None
    # Highest usable speed, where the present speed is higher, m/s.
    usable_speed_mps: float | None
    area_ha: float
    applied_kg: float
    # Present while calibrating.
    bench: BenchRun | None
    # Learnt threshold of point mode at this speed, m.
    threshold_m: float | None
    # Sections from left to right; empty for a machine without valves.
    sections: tuple[SectionState, ...]
    # N-rich strip and farmer check as they apply now.
    strips: ReferenceStrips
    # Sources of the target that the job has.
    sources: tuple[TargetSource, ...]
    # Rate of each source here, kg/ha, without the nudge; None for single doses.
    source_rates: tuple[float | None, ...]
    # Finding on the metering drive's effort.
    effort: EffortFinding

    @property
    def is_enabled(self) -> bool:
        """Returns whether the drives have power."""
        return self.verdict.state in POWERED_STATES

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Returns the live alarms, worst first."""
        return self.verdict.alarms

    @property
    def why_no_flow(self) -> tuple[str, ...]:
        """Returns the interlocks that forbid flow."""
        return self.verdict.why_no_flow

    @property
    def why_state(self) -> str:
        """Returns the reason for the state: an order, an alarm id, or one of STATE_REASONS."""
        return self.verdict.why_state

    @property
    def gnss_age_s(self) -> float | None:
        return self.sensed.gnss_age_s

    @property
    def gnss_hz(self) -> float | None:
        """Returns the observed rate of GNSS epochs, Hz; None for a silent receiver."""
        return 1.0 / self.sensed.gnss_period_s if self.sensed.gnss_age_s is not None else None

    @property
    def place_m(self) -> tuple[float, float] | None:
        """Returns the position of the outlets, east and north, m."""
        east, north = self.sensed.east_m, self.sensed.north_m
        return None if east is None or north is None else (east, north)

    @property
    def ordered_source(self) -> str:
        """Returns the source of the target that the operator ordered; the row has its
        replacement where the source is silent."""
        return self.choices.source.value

    @property
    def manual_rate_kg_ha(self) -> float:
        return self.choices.manual_rate_kg_ha

    @property
    def look_ahead(self) -> bool:
        return self.choices.look_ahead

    @property
    def flow_trim_on(self) -> bool:
        return self.choices.flow_trim_on

    @property
    def no_double(self) -> bool:
        return self.choices.no_double

"""Is the effort of the metering drive as expected? A control loop hides a change of effort.
Pure.
"""

from __future__ import annotations

from math import hypot, inf

from topdress.control.log_row import VALID_FOR_S
from topdress.control.machine.effort import EffortInput, calc_shaft_parts, calc_supply_factor
from topdress.control.machine.flow import calc_flute_load
from topdress.control.machine.machine import Machine
from topdress.control.metering.inverse_model import Conditions
from topdress.control.readings import (
    NO_EFFORT_FINDING,
    EffortFinding,
    Measurements,
    find_valid_value,
)

# Time constant of the mean effort, s: 96 % of a step within the 10 s before a report.
EFFORT_MEAN_S = 3.0
# Time constant of the drive's usual effort, s: its own error adds 0.5 % to the noise.
USUAL_MEAN_S = 100.0 * EFFORT_MEAN_S
# Turning time before the usual effort is trusted, s: its error then adds a tenth.
USUAL_SETTLING_S = 10.0 * EFFORT_MEAN_S
# Limit in standard deviations of the machine file's tolerance, which is the difference of healthy
# drives between runs (1.8 to 3.5 %: Cranfield's ball screw). One healthy drive of 740 exceeds the
# limit until its own reference is measured.
MIN_TOLERANCE_SD = 3.0
# Limit in standard deviations of the mean, by the machine file's noise of a reading (`calibrate
# effort` estimates the noise from the residuals of a healthy run). By chance the mean exceeds the
# limit on either side after MEAN_S sqrt(2 pi) exp(NOISE_SD^2 / 2) / NOISE_SD of turning on average
# (first passage of a first-order process: Siegert, Phys. Rev. 81, 1951, 617): 23,000 h; a season
# has some 300.
NOISE_LIMIT_SD = 6.0
# Share of the bounds below which a finding ends: at the bound itself noise would make the finding
# flicker.
FINDING_END_OF_BOUND = 0.5
# Turning time within the reduced bounds after which a finding ends, s.
RECOVERY_S = 5.0 * EFFORT_MEAN_S
# Relative increase of a duty cycle when an unmeasured supply voltage falls with the idling engine.
IDLING_DUTY_RISE_SHARE = 1.2 / 12.3
# Share of the material's load that separates a loaded from an unloaded drive: both errors are then
# equally likely.
UNLOADED_DRIVE_LOAD_SHARE = 0.5


class EffortWatch:
    """Monitors the metering drive's effort. `finding` is the present finding; `update_watch` is
    called once a tick.

    A sudden change is compared with this drive's last minutes; a constant deviation with the
    machine file and its tolerances.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine, self._tells = machine, machine.has_stage("effort")
        # Measured minus expected effort.
        self._off: float | None = None
        # Mean of the relative difference over minutes, and the turning time behind it, s.
        self._usual = self._turned_s = 0.0
        # Time within the bounds since a finding, s.
        self._back_s = 0.0
        # Value of `_usual` at the last judgement.
        self._said_share = 0.0
        self._rests = NO_EFFORT_FINDING._replace(unit=machine.effort_unit if self._tells else "")
        self.finding = self._rests

    def update_watch(self, m: Measurements, c: Conditions, dt_s: float, turns: bool) -> None:
        """Updates the monitor with one tick. turns: whether a turning shaft should meter
        material; otherwise nothing is judged."""
        effort, rpm, opening_mm = (
            find_valid_value(read, m.time_s, VALID_FOR_S["shaft_effort"])
            if self._tells and turns
            else None
            for read in (m.shaft_effort, m.shaft_rpm, m.opening_mm)
        )
        if effort is None or rpm is None or opening_mm is None or not rpm > 0.0:
            # A finding remains until the shaft turns again.
            self._off, self.finding = (
                None,
                self._rests._replace(
                    harder_percent=self.finding.harder_percent, unloaded=self.finding.unloaded
                ),
            )
            return
        machine, own = self._machine, self._machine.effort
        u = make_effort_input(machine, rpm, opening_mm, c)
        supply = calc_supply_factor(own, u)
        friction, drag, _gains, load = (supply * part for part in calc_shaft_parts(own, u))
        should = max(0.0, friction + drag + load)
        share = min(1.0, dt_s / EFFORT_MEAN_S)
        usual = (
            self._said_share
            if self.finding.harder_percent or self.finding.unloaded
            else self._usual
        )
        before = usual * should if self._off is None else self._off
        off = self._off = before + share * (abs(effort) - should - before)
        self._turned_s += dt_s
        usual = self._usual * should
        chance = NOISE_LIMIT_SD * machine.noise.effort * (0.5 * share) ** 0.5
        unknown = own.by_supply * IDLING_DUTY_RISE_SHARE * should if c.supply_v is None else 0.0
        keeps = (
            FINDING_END_OF_BOUND if self.finding.harder_percent or self.finding.unloaded else 1.0
        )
        sudden = keeps * max(UNLOADED_DRIVE_LOAD_SHARE * load, chance, unknown)
        # Standard deviation of a healthy drive's effort, from its parameters within their
        # tolerances and from its supply.
        sd = hypot(
            0.01 * machine.tolerance.effort_percent * hypot(friction, drag, load), 0.5 * unknown
        )
        far = max(sudden, keeps * MIN_TOLERANCE_SD * sd)
        more, less = (
            (usual + sudden, usual - sudden) if self._turned_s > USUAL_SETTLING_S else (inf, -inf)
        )
        more, less = min(far, more), max(-far, less) if load > chance else -should
        high, low = off > more, off < less
        # While the shaft decelerates at the end of a pass, the effort hardly shows a fault.
        self._back_s = 0.0 if high or low or keeps == 1.0 else self._back_s + dt_s
        harder_percent = 100.0 * max(off, off - usual) / max(should, 1e-9) if high else 0.0
        if 0.0 < self._back_s < RECOVERY_S:
            harder_percent, low = self.finding.harder_percent, self.finding.unloaded
            high = harder_percent > 0.0
        self.finding = EffortFinding(
            harder_percent,
            low,
            should + off,
            should,
            max(0.0, should + less),
            should + more,
            machine.effort_unit,
        )
        self._said_share = off / max(should, 1e-9)
        if not (high or low):
            self._usual += min(1.0, dt_s / min(USUAL_MEAN_S, self._turned_s)) * (
                off / max(should, 1e-9) - self._usual
            )


def make_effort_input(
    machine: Machine, rpm: float, opening_mm: float, c: Conditions
) -> EffortInput:
    """Returns the variables of the metering drive's effort at a steady speed."""
    full = 1.0 if c.hopper_kg is None else c.hopper_kg / machine.flow.full_kg
    nominal_v = machine.shaft.nominal_supply_v
    return EffortInput(
        rpm,
        0.0,
        nominal_v / max(1.0, nominal_v if c.supply_v is None else c.supply_v),
        *calc_flute_load(
            machine.flow,
            rpm,
            max(0.0, opening_mm - machine.gate.offset_mm),
            c.pitch_deg,
            full,
            c.elapsed_s,
            0.0,
            c.refilled,
        ),
    )

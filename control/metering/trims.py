"""How are shaft and gate corrected towards their measured values? Slow, bounded integrators.
`flow_trim` is the scale's trim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from topdress.control.readings import Reading


@dataclass(frozen=True)
class TrimLimits:
    """Holds time constants and bounds of the trims."""

    # Time constant of both integrators, s.
    tau_s: float = 5.0
    # Greatest trim of the shaft, as a share of the command.
    shaft_share: float = 0.10
    # Relative error beyond which the shaft is jammed and the integrator stops (anti-windup).
    jammed_share: float = 0.30
    # Greatest trim of the gate, mm.
    gate_mm: float = 2.0
    # Minimum time without a change of the expected value, s.
    settled_s: float = 0.6
    # Time constant of the filter `find_uncorrected`, s: it reduces the encoder's noise of 0.3
    # r/min to 0.05.
    left_tau_s: float = 1.0


class UncorrectedError(NamedTuple):
    """Holds the errors of the drives against their expected values, trims included, as far as
    they are to be compensated."""

    # Error as a share of the expected speed.
    shaft_share: float = 0.0
    gate_mm: float = 0.0


NO_ERROR = UncorrectedError()


class DriveTrim:
    """Integrates the difference of measured and expected value while the expected one stands
    still."""

    def __init__(self, limits: TrimLimits, still: float) -> None:
        self.shaft_share = 0.0
        self.gate_mm = 0.0
        # State of the filter `find_uncorrected`: the error that remains while the expected value
        # stands still.
        self._left = NO_ERROR
        self._limits = limits
        # Maximum change of an expected value that counts as constant.
        self._still = still
        # Expected value, and the time since which it is constant, s.
        self._shaft: tuple[float, float] = (0.0, -1e9)
        self._gate: tuple[float, float] = (0.0, -1e9)

    def update_trims(
        self,
        now_s: float,
        dt_s: float,
        expected_rpm: float,
        measured_rpm: Reading | None,
        expected_mm: float,
        measured_mm: Reading | None,
    ) -> None:
        """Takes the readings of one tick. The expected values are those of the nominal drive
        with the untrimmed set-points."""
        lim = self._limits
        self._shaft = _track_standstill(self._shaft, expected_rpm, now_s, self._still)
        self._gate = _track_standstill(self._gate, expected_mm, now_s, self._still)
        share, left_share = dt_s / lim.tau_s, min(1.0, dt_s / lim.left_tau_s)
        left_shaft, left_mm = self._left
        if (
            measured_rpm is not None
            and now_s - measured_rpm.time_s < 0.2
            and expected_rpm > 5.0
            and now_s - self._shaft[1] > lim.settled_s
        ):
            off = (measured_rpm.value - expected_rpm) / expected_rpm
            if abs(off) <= lim.jammed_share:
                self.shaft_share = _limit_magnitude(self.shaft_share - share * off, lim.shaft_share)
                left_shaft += left_share * (off - left_shaft)
        if (
            measured_mm is not None
            and now_s - measured_mm.time_s < 0.2
            and now_s - self._gate[1] > lim.settled_s
        ):
            off_mm = measured_mm.value - expected_mm
            self.gate_mm = _limit_magnitude(self.gate_mm - share * off_mm, lim.gate_mm)
            if abs(off_mm) <= lim.jammed_share * expected_mm:
                left_mm += left_share * (off_mm - left_mm)
        self._left = UncorrectedError(left_shaft, left_mm)

    def find_uncorrected(self, shaft_moves: bool) -> UncorrectedError:
        """Returns the errors that the moving drive is to compensate: the present error of the
        drive that rests, and its own where its trim is at its bound."""
        shaft_share, gate_mm = self._left
        if shaft_moves:
            return UncorrectedError(
                shaft_share if abs(self.shaft_share) >= self._limits.shaft_share else 0.0, gate_mm
            )
        return UncorrectedError(
            shaft_share, gate_mm if abs(self.gate_mm) >= self._limits.gate_mm else 0.0
        )


def _track_standstill(
    held: tuple[float, float], value: float, now_s: float, still: float
) -> tuple[float, float]:
    return held if abs(value - held[0]) <= still else (value, now_s)


def _limit_magnitude(value: float, most: float) -> float:
    return min(most, max(-most, value))

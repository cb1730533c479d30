"""The host's slow corrections of shaft and gate to their measured values, bounded. The scale's: `flow_trim`."""
from __future__ import annotations

from dataclasses import dataclass

from control.readings import Reading


@dataclass(frozen=True)
class TrimLimits:
    tau_s: float = 5.0                  # how slowly shaft and gate are trimmed
    shaft_share: float = 0.10           # at most, of the command
    held_share: float = 0.30            # further off the shaft is jammed or held: nothing is learnt (anti-windup)
    gate_mm: float = 2.0                # at most
    settled_s: float = 0.6              # the expected value must have stood still this long


class DriveTrim:
    """Integrates the difference of measured and expected while the expected stands still."""

    def __init__(self, limits: TrimLimits, still: float) -> None:
        self.shaft_share = 0.0
        self.gate_mm = 0.0
        self._limits = limits
        self._still = still             # a move of the expected value larger than this is not standing still
        self._shaft: tuple[float, float] = (0.0, -1e9)      # value, since when
        self._gate: tuple[float, float] = (0.0, -1e9)

    def update(self, now_s: float, dt_s: float, expected_rpm: float, measured_rpm: Reading | None,
               expected_mm: float, measured_mm: Reading | None) -> None:
        """Expected: what the nominal drive does with the untrimmed set-points."""
        lim = self._limits
        self._shaft = _stands(self._shaft, expected_rpm, now_s, self._still)
        self._gate = _stands(self._gate, expected_mm, now_s, self._still)
        share = dt_s / lim.tau_s
        if (measured_rpm is not None and now_s - measured_rpm.time_s < 0.2 and expected_rpm > 5.0
                and now_s - self._shaft[1] > lim.settled_s):
            off = (measured_rpm.value - expected_rpm) / expected_rpm
            if abs(off) <= lim.held_share:
                self.shaft_share = _bounded(self.shaft_share - share * off, lim.shaft_share)
        if (measured_mm is not None and now_s - measured_mm.time_s < 0.2
                and now_s - self._gate[1] > lim.settled_s):
            self.gate_mm = _bounded(self.gate_mm - share * (measured_mm.value - expected_mm), lim.gate_mm)


def _stands(held: tuple[float, float], value: float, now_s: float, still: float) -> tuple[float, float]:
    return held if abs(value - held[0]) <= still else (value, now_s)


def _bounded(value: float, most: float) -> float:
    return min(most, max(-most, value))

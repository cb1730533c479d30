"""The host's slow corrections: shaft and gate to their measured values, the flow model to the scale. All bounded."""
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
    window_kg: float = 15.0             # the scale speaks once this much has left the hopper
    window_most_s: float = 900.0
    flow_share: float = 0.25            # at most
    flow_believes: float = 0.5          # of each window's verdict


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


class FlowTrim:
    """Scale against model, a window of `window_kg` at a time: actual over expected mass.

    Filter `flow_trim`: mean of the scale over 5 s at each end of a window, half of each verdict believed; it stands
    half-way after one window (about three minutes at 0.09 kg/s), never faster than the scale's noise allows
    (0.15 kg correlated over 1 s leaves about 0.07 kg in a mean of 5 s: 0.7 % of a window).
    """

    MEAN_S = 5.0

    def __init__(self, limits: TrimLimits) -> None:
        self.value = 1.0
        self._limits = limits
        self._samples: list[tuple[float, float]] = []       # (expected kg so far, scale kg) inside the running mean
        self._times: list[float] = []
        self._start: tuple[float, float] | None = None      # mean expected, mean scale at the window's begin
        self._expected_kg = 0.0
        self._begun_s = 0.0
        self._last_scale: float | None = None

    def restart(self) -> None:
        """After a refill, a pause or a tare: what came before says nothing of what comes."""
        self._samples.clear()
        self._times.clear()
        self._start = None

    def update(self, now_s: float, dt_s: float, model_flow_kg_s: float, scale: Reading | None) -> None:
        """`model_flow_kg_s`: from measured shaft and opening, without this trim."""
        self._expected_kg += model_flow_kg_s * dt_s
        if scale is None or now_s - scale.time_s > 1.0:
            return
        if self._last_scale is not None and scale.value - self._last_scale > 2.0:
            self.restart()
        self._last_scale = scale.value
        self._samples.append((self._expected_kg, scale.value))
        self._times.append(now_s)
        if self._times[-1] - self._times[0] < self.MEAN_S:
            return
        count = len(self._samples)
        here = (sum(e for e, _ in self._samples) / count, sum(k for _, k in self._samples) / count)
        self._samples.clear()
        self._times.clear()
        if self._start is None:
            self._start, self._begun_s = here, now_s
            return
        expected = here[0] - self._start[0]
        if now_s - self._begun_s > self._limits.window_most_s:
            self._start = None
        elif expected >= self._limits.window_kg:
            actual = self._start[1] - here[1]
            believed = self._limits.flow_believes
            wanted = self.value + believed * (actual / expected - self.value)
            most = self._limits.flow_share
            self.value = min(1.0 + most, max(1.0 - most, wanted))
            self._start, self._begun_s = here, now_s

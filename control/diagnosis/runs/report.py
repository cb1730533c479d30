"""How well the nominal model predicts each channel: the first table of a diagnosis."""
from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from control.diagnosis.result import Channel
from control.machine.machine import Machine

from .selection import Named
from .stages import RunData

Array = npt.NDArray[np.float64]
WINDOW_S = 10.0             # flow is read off the scale over windows of this length


def shown(one: Named, data: RunData, machine: Machine) -> list[Channel]:
    """Channels of one group in the result's words; the scale's reading gives both flow and scale."""
    left = one.group.residual(())
    found: list[Channel] = []
    for channel in one.group.channels:
        residual, measured = left[channel.name], channel.measured
        noise = one.found.noise[channel.name]
        floor = float(np.hypot(noise.fast_sd, channel.prior.floor_sd))
        p = _structure_p(one)
        if channel.name == "scale":
            found.append(_flow(channel.grid.even_s, measured, residual, noise.fast_sd, p, data))
            residual = residual - np.median(residual[:10])
        spread = float(np.var(measured))
        found.append(Channel(channel.name, channel.unit, len(residual), float(residual.mean()),
                             float(np.sqrt(np.mean(residual ** 2))), floor,
                             float(1.0 - np.var(residual) / spread) if spread > 0.0 else 0.0, p))
    return found


def _structure_p(one: Named) -> float:
    """Probability of the best single explanation's gain where there is nothing, over the catalogue searched."""
    gain = max([f.gain for f in one.scan[:1]] + [2.0 * (one.found.log_likelihood - one.null.log_likelihood)]
               + ([one.table.gain] if one.table is not None else []))
    single = float(chi2.sf(max(gain, 0.0), 1.0))
    return float(1.0 - (1.0 - single) ** max(1, len(one.scan)))


def _flow(time_s: Array, reading: Array, residual: Array, noise_kg: float, p: float, data: RunData) -> Channel:
    """Flow read off the scale's decrements over WINDOW_S of working time."""
    step = float(time_s[1] - time_s[0])
    hop = max(1, int(round(WINDOW_S / step)))
    working = np.interp(time_s, data.time_s, data.working)
    level = np.arange(0, len(reading) - hop, hop)
    on = np.array([working[k:k + hop].mean() > 0.8 and reading[k + hop] - reading[k] < 1.0 for k in level], bool)
    if not on.any():
        return Channel("flow", "kg/s", 0, 0.0, 0.0, 0.0, 0.0, p)
    span_s = hop * step
    measured = -(reading[level + hop] - reading[level])[on] / span_s
    wrong = -(residual[level + hop] - residual[level])[on] / span_s
    spread = float(np.var(measured))
    return Channel("flow", "kg/s", len(measured), float(wrong.mean()), float(np.sqrt(np.mean(wrong ** 2))),
                   float(np.sqrt(2.0) * noise_kg / span_s),
                   float(1.0 - np.var(wrong) / spread) if spread > 0.0 else 0.0, p)

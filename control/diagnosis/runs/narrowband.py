"""Narrowband noise of a speed sensor: only what is slower than it is compared.

The two speeds are held against each other, and both have errors: shifted in time, the oscillation of one cancels
against itself, so that it passes for a latency; and a noise model of two first-order components takes the power of its
one line for noise at every frequency about it. No tractor swings as quickly, so that nothing is lost.
"""
from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import fdtrc

from control.diagnosis.judgement import noise as noises
from control.diagnosis.judgement.checks import LEVEL
from control.diagnosis.judgement.noise_fit import BAND_DOF
from control.machine.machine import Machine
from control.machine.over_log import MOST_STEP_S

from .channels import ChannelSeries
from .hypothesis import schedule, stages_of

QUICK_S = 4.5               # a longer period may be the ground's
SLOWER = 1.5                # times that period: a damped oscillation reaches so far
ABOUT = 4                   # bands on either side, an octave and more: their median does not move with one line


def without_narrowband(seen: dict[str, ChannelSeries], machine: Machine) -> tuple[dict[str, ChannelSeries], list[str]]:
    """The channels, the speed's without its narrowband noise; a sentence where there was any."""
    if "speed" not in seen:
        return seen, []
    channel = seen["speed"]
    periods_s = narrowband_periods_s(channel, machine)
    if not len(periods_s):
        return seen, []
    least_s = max(QUICK_S, SLOWER * float(periods_s.max()))
    quick = channel.cut.omega * least_s > 2.0 * np.pi * channel.grid.step_s
    if quick.all():
        return seen, []
    said = " and ".join(f"{period_s:.2g} s" for period_s in periods_s)
    return ({**seen, "speed": channel._replace(cut=noises.leaving_out(channel.cut, quick))},
            [f"speed: a sensor oscillates with a period of {said}; the speeds are compared over "
             f"periods longer than {least_s:.2g} s"])


def narrowband_periods_s(channel: ChannelSeries, machine: Machine) -> npt.NDArray[np.float64]:
    """Periods at which the nominal machine leaves a quick line in a channel, s, longest first (k,).

    A band's power over what the bands about it have is an F variable: its own coefficients, and those that its variance
    is worth (`BAND_DOF`). All bands together have the level of the other checks.
    """
    left = channel.measured - channel.predict(schedule(stages_of(machine), ()), MOST_STEP_S)
    cut, step_s = channel.cut, channel.grid.step_s
    power = np.add.reduceat(noises.coefficients(left, cut) ** 2, cut.starts)
    fitted = noises.fit(power, noises.start(channel.prior), channel.prior, cut, step_s)
    over = power / cut.members / noises.spectrum(np.array(fitted.theta), channel.prior, cut, step_s)
    about = [np.r_[max(0, k - ABOUT):k, k + 1:min(len(over), k + 1 + ABOUT)] for k in range(len(over))]
    usual = np.array([float(np.median(over[near])) if len(near) else np.inf for near in about])
    by_chance = fdtrc(cut.members, BAND_DOF, over / np.maximum(usual, 1e-300))
    stand_out = (by_chance < LEVEL / len(over)) & (cut.omega * QUICK_S > 2.0 * np.pi * step_s)
    return np.asarray(2.0 * np.pi / cut.omega[stand_out] * step_s)

"""When an effect began: stops read off the drives, other onsets tried on a grid and then refined."""
from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from control.machine.machine import CATALOGUE

from .hypothesis import Part, Parts
from .search import Group, Refit
from .sensitivities import Candidate
from .stages_data import RunData

Array = npt.NDArray[np.float64]

TIMES = 16                  # onsets tried over the working time
STILL_S = 3.0               # a drive must disobey for this long in all
STILL_GAIN = 60.0           # of twice the log-likelihood, for one constant against the model
ONSET_SHARE = 0.08          # of what the effect explains: forms are never quite right
NEVER_WITH_ONSET = frozenset({"flow.batch", "flow.moisture_drift", "scale.drift", "gate.lost_steps"})


def working_times(data: RunData, count: int = TIMES) -> Array:
    """Times that cut the working time into equal parts, ends left out: (count,)."""
    done = np.cumsum(data.working)
    if done[-1] <= 0:
        return np.linspace(data.time_s[0], data.time_s[-1], count + 2)[1:-1]
    return np.interp(np.linspace(0.0, done[-1], count + 2)[1:-1], done, data.time_s)


def blocked(data: RunData) -> list[Candidate]:
    """An outlet that closes at some time."""
    entry = CATALOGUE["flow.blocked_outlet"]
    return [Candidate(Part("flow.blocked_outlet", 2.0, float(at)), 0.0, entry.high) for at in working_times(data)]


def stops(group: Group, data: RunData) -> list[Candidate]:
    """Drives that stood still to the end of the log though commanded."""
    found: list[Candidate] = []
    predicted = group.predicted(())
    calm = {c.name: median_filter(c.measured, 5) for c in group.channels if c.name in ("shaft", "gate")}
    for channel in group.channels:
        if channel.name == "shaft":
            asked = predicted["shaft"] > 5.0
            obeyed = asked & (calm["shaft"] > 0.3 * predicted["shaft"])
            at = _last_obeyed(asked, obeyed, channel.grid.step_s)
            effect = "shaft.stall"
        elif channel.name == "gate":
            noise = channel.prior.fast_sd
            final = float(np.median(calm["gate"][-max(5, int(1.0 / channel.grid.step_s)):]))
            moves = np.abs(calm["gate"] - final) > 5.0 * noise
            asked = np.abs(predicted["gate"] - final) > 1.0 + 6.0 * noise
            at = _last_obeyed(asked, moves, channel.grid.step_s)
            if at is None:
                least = int(np.ceil(STILL_S / channel.grid.step_s))
                at = _still_from(channel.measured, predicted["gate"], noise, least)
            effect = "gate.stuck"
        else:
            continue
        if at is not None and at > 0:
            found.append(Candidate(Part(effect, 1.0, float(channel.grid.even_s[at])), 1.0, 1.0))
    return found


def _still_from(measured: Array, predicted: Array, noise: float, least: int) -> int | None:
    """Sample from which a reading is better told by one constant than by its prediction, to the end of the log.

    Moves smaller than the noise of one reading add up: sums of squares from every sample to the end are compared.
    """
    count = np.arange(len(measured), 0, -1)
    ahead = np.cumsum(measured[::-1])[::-1]
    about_mean = np.cumsum((measured ** 2)[::-1])[::-1] - ahead ** 2 / count
    about_model = np.cumsum(((measured - predicted) ** 2)[::-1])[::-1]
    better = (about_model - about_mean)[:-least] / noise ** 2
    if len(better) < 1 or float(better.max()) < STILL_GAIN:
        return None
    return int(np.argmax(better))


def _last_obeyed(asked: npt.NDArray[np.bool_], obeyed: npt.NDArray[np.bool_], step_s: float) -> int | None:
    """Sample after the last one at which the drive did something, where it was asked for long after that."""
    did = np.flatnonzero(obeyed)
    last = int(did[-1]) if len(did) else 0
    return last + 1 if asked[last + 1:].sum() * step_s > STILL_S else None


def with_onset(group: Group, found: Refit, data: RunData, threshold: float) -> Refit:
    """The hypothesis with an onset for the part that gains most by one, where it gains more than `threshold`."""
    best = found
    for k, part in enumerate(found.parts):
        if part.onset_s is not None or part.id in NEVER_WITH_ONSET or CATALOGUE[part.id].effect.onset_only:
            continue
        others: Parts = (*found.parts[:k], *found.parts[k + 1:])
        if sum(p.onset_s is not None for p in others) >= 2:
            continue
        low, high = CATALOGUE[part.id].low, CATALOGUE[part.id].high
        tried = [Candidate(part._replace(onset_s=float(at)), low, high) for at in working_times(data)]
        ranked = group.scan(others, found.noise, tried)
        if not ranked:
            continue
        better = group.refit((*others, _as_blocked(ranked[0].part)), found.noise)
        alone = group.refit(others, found.noise)
        reach = max(threshold, ONSET_SHARE * 2.0 * (found.log_likelihood - alone.log_likelihood))
        if 2.0 * (better.log_likelihood - best.log_likelihood) > reach:
            best = refined(group, better, data)
    return best


def _as_blocked(part: Part) -> Part:
    if part.id == "flow.gain" and part.size < 0.0:
        return Part("flow.blocked_outlet", -part.size, part.onset_s)
    return part


def refined(group: Group, found: Refit, data: RunData) -> Refit:
    """Onsets moved to where they fit best, in ever smaller steps."""
    best = found
    step = float(np.median(np.diff(working_times(data))))
    for _ in range(5):
        step *= 0.45
        for k, part in enumerate(best.parts):
            if part.onset_s is None or CATALOGUE[part.id].effect.onset_only:
                continue
            for moved_s in (part.onset_s - step, part.onset_s + step):
                if not data.time_s[0] < moved_s < data.time_s[-1]:
                    continue
                parts = (*best.parts[:k], part._replace(onset_s=moved_s), *best.parts[k + 1:])
                tried = group.refit(parts, best.noise)
                if tried.log_likelihood > best.log_likelihood:
                    best = tried
    return best

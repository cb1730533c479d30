"""Searches over hypotheses of one group: scans candidates by their columns and refits the best
through the model.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import (
    EFFECT_ROWS,
    FLOW_BLOCKED_OUTLET,
    FLOW_GAIN,
    FoundBy,
    LogRequirement,
    find_size_range,
)
from topdress.control.diagnosis.judgement.evidence import (
    TWO_SIDED_90_QUANTILE,
    ColumnRole,
    Fit,
    Problem,
    adapt_noise,
    choose_better_fit,
    fit_amplitudes_and_noise,
    fit_first_noise,
    limit_slow_noise,
    project_out_fixed,
)
from topdress.control.diagnosis.judgement.gaussian import ColumnProducts
from topdress.control.diagnosis.judgement.line_search import climb_to_best
from topdress.control.diagnosis.judgement.noise import Noise
from topdress.control.diagnosis.judgement.prior import find_size_log_weight, find_size_sd
from topdress.control.machine.effect import OPENING_RANGE
from topdress.control.machine.machine import CATALOGUE, Machine, calc_size_scale, scale_nominal

from .channels import ChannelSeries
from .columns import NOTED_REFILL, HypothesisColumns
from .drives import measure_zero_offset
from .hypothesis import EffectInstance, Hypothesis, replace_part
from .model import GroupModel
from .stages import RunData

Array = npt.NDArray[np.float64]

# Cosine of two effects' traces above which rounding decides their sizes.
MAX_COLLINEARITY = 0.999
# Maximum number of rounds of a refit: the model is run, then sizes are fitted.
MAX_ROUNDS = 4
# A refit ends where no size changes by more than this, in standard deviations of the size.
MAX_SETTLED_SD = 0.05
# Minimum gain in twice the log-likelihood for the noise to be fitted as well.
MIN_NOISE_FIT_GAIN = 4.0
# Minimum range of the opening between 1st and 99th percentile, mm, for a gate's backlash and slew
# rate, on the nominal machine.
MIN_OPENING_RANGE_MM = 2.0
# Maximum row distance, s, at which a missing pulse shows as a dip.
MAX_DIP_STEP_S = 0.5
# First step of a line search, as a share of a log row.
FIRST_STEP_ROW_SHARE = 0.5
# Last step of a line search, as a share of the size's standard deviation.
LAST_STEP_SD = 0.5
# Last step as a share of the first, where the standard deviation is 0.
LAST_STEP_SHARE = 1e-6
# Number of trial thresholds over the range of commands.
THRESHOLD_COUNT = 16
# Drop of twice the log-likelihood at the ends of a 90 % interval (chi-square, one degree of
# freedom).
INTERVAL_DROP = 2.7


class Candidate(NamedTuple):
    """A candidate effect with the bounds of its size."""

    part: EffectInstance
    low: float
    high: float
    # Prior standard deviation of the size.
    usual: float = np.inf


class ScoreTest(NamedTuple):
    """Result of the score test of a candidate."""

    # The effect with its estimated size.
    part: EffectInstance
    # Gain in twice the log-likelihood.
    gain: float
    # Gain in log evidence, with size and times integrated.
    evidence: float = 0.0
    # Reduction of the log evidence, because the times were unknown.
    spent: float = 0.0


class FittedHypothesis(NamedTuple):
    """A fully refitted hypothesis."""

    parts: Hypothesis
    # Standard deviations of the sizes.
    sd: tuple[float, ...]
    log_likelihood: float
    noise: dict[str, Noise]
    # Largest correlation between two sizes.
    collinearity: float = 0.0
    # Log evidence with sizes integrated, without the priors of the effects and of their times.
    log_evidence: float = 0.0


def find_log_likelihood(one: FittedHypothesis) -> float:
    return one.log_likelihood


class Search:
    """Model of a group, its columns, and the candidates that are tried on the group.

    curves : function that yields hypotheses of several effects at once.
    """

    def __init__(
        self,
        channels: Sequence[ChannelSeries],
        machine: Machine,
        data: RunData,
        ask: Callable[[], None] = lambda: None,
        curves: Callable[[], Sequence[Hypothesis]] = tuple,
    ) -> None:
        self.curves = curves
        self.model = GroupModel(channels, machine, data, ask)
        self.columns = HypothesisColumns(self.model)
        refilled = data.hopper is not None and bool(data.hopper.jumps)
        every = list_candidates(self.model.names, machine, self.model.heads, refilled)
        self.candidates = [
            c._replace(usual=EFFECT_ROWS[c.part.id].scale_to_machine(machine).usual)
            for c in every
            if is_excited(c, data, machine)
        ]
        # Thresholds that were searched for over the whole range.
        self._all_over: set[str] = set()

    def scan_candidates(self, parts: Hypothesis, noise: dict[str, Noise]) -> list[ScoreTest]:
        """Test every candidate on top of a refitted hypothesis, and return the tests, best first,
        one for each effect and member.

        The score test takes one step from the hypothesis along the candidate's column. Where the
        step gains enough, the noise is fitted as well.
        """
        tried = [
            c
            for c in self.candidates
            if EFFECT_ROWS[c.part.id].found_by is not FoundBy.ONSET
            and not any(p.id == c.part.id and p.member == c.part.member for p in parts)
        ]
        p, before = self.columns.compress_hypothesis(
            parts, [self.columns.make_candidate_column(parts, c.part) for c in tried]
        )
        fixed = np.arange(before)
        null = choose_better_fit(p, fixed, noise, self.model.channels)
        starts = [
            null.noise,
            adapt_noise(
                p, fixed, null.amplitude, limit_slow_noise(null.noise, self.model.channels)
            ),
        ]
        beyond = [project_out_fixed(p, fixed, start) for start in starts]
        best: dict[tuple[str, int | None], ScoreTest] = {}
        for k, c in enumerate(tried):
            self.model.ask()
            found = ScoreTest(c.part, -np.inf, -np.inf)
            for start, left in zip(starts, beyond, strict=True):
                found = max(
                    found,
                    _score_added_column(p, before + k, c, null, start, left),
                    key=lambda f: f.evidence,
                )
            name = (c.part.id, c.part.member)
            if name not in best or found.evidence > best[name].evidence:
                best[name] = found
        return sorted(best.values(), key=lambda f: -f.evidence)

    def rename_started_effect(self, part: EffectInstance) -> EffectInstance:
        """Return the effect under the name that it has where it begins within a run.

        A sudden loss of flow is a blocked outlet where no drive shows its load. Where a drive does,
        the load separates the two effects, and each is a candidate.
        """
        lost = (
            part.id == FLOW_GAIN.id
            and part.size < 0.0
            and part.onset_s is not None
            and not part.grows
        )
        return (
            part._replace(id=FLOW_BLOCKED_OUTLET.id, size=-part.size)
            if (lost and not _is_load_telling(self.model.names, self.model.machine))
            else part
        )

    def refit_hypothesis(
        self, parts: Hypothesis, noise: dict[str, Noise] | None = None
    ) -> FittedHypothesis:
        """Refit a hypothesis: rerun the model until the sizes converge, and return sizes, standard
        deviations and likelihood."""
        now, last, best = parts, noise or self.model.noise, None
        for _ in range(MAX_ROUNDS):
            p, fit = self._fit_about(now, last)
            if best is not None and fit.log_likelihood < best.log_likelihood - 0.5:
                now = tuple(
                    a._replace(size=0.5 * (a.size + b.size))
                    for a, b in zip(best.parts, now, strict=True)
                )
                p, fit = self._fit_about(now, last)
            moved, sd, biggest = _step_hypothesis(now, p, fit, self.model.machine)
            last = fit.noise
            best = FittedHypothesis(
                now,
                sd,
                fit.log_likelihood,
                fit.noise,
                self._calc_collinearity(p, fit.noise),
                self._calc_form_evidence(p, fit),
            )
            if biggest < MAX_SETTLED_SD:
                best = best._replace(parts=moved)
                break
            now = moved
        # The linear step exceeds the model's range, so the likelihood at the last run counts.
        else:
            best = best and self._fit_at_rerun_sizes(best, p, fit)
        assert best is not None
        return (
            self._move_threshold(best)
            if any(EFFECT_ROWS[part.id].threshold for part in best.parts)
            else best
        )

    def fit_start_noise(self) -> None:
        """Fit the noise of the model without any fault, from which further fits start."""
        p, count = self.columns.compress_hypothesis(())
        self.model.noise = fit_first_noise(
            p, np.arange(count), self.model.noise, self.model.channels
        )

    def _calc_form_evidence(self, p: Problem, fit: Fit) -> float:
        """Return the log evidence of a hypothesis whose forms are, with equal odds, the catalogue's
        own or free."""
        forms = p.find_indices(ColumnRole.FORM)
        if not forms:
            return fit.log_evidence
        stand = np.flatnonzero(fit.amplitude == 0.0)
        exact = fit_amplitudes_and_noise(
            p, np.setdiff1d(np.arange(len(fit.amplitude)), [*forms, *stand]), fit.noise
        )
        return float(np.logaddexp(fit.log_evidence, exact.log_evidence) - np.log(2.0))

    def _fit_about(self, parts: Hypothesis, noise: dict[str, Noise]) -> tuple[Problem, Fit]:
        """Return the best fit around a hypothesis. A size at its bound that is pulled outwards
        stays there, with amplitude 0."""
        p, count = self.columns.compress_hypothesis(parts)
        fit = choose_better_fit(p, np.arange(count), noise, self.model.channels)
        off = [
            k
            for k, label in enumerate(p.labels)
            if label.name == NOTED_REFILL and abs(fit.amplitude[k]) > p.sd[k]
        ]
        if off:
            sd = p.sd.copy()
            sd[off] = np.abs(fit.amplitude[off])
            p = p._replace(sd=sd, log_weight=float(np.sum(np.log(p.sd[off] / sd[off]))))
            fit = choose_better_fit(p, np.arange(count), fit.noise, self.model.channels)
        stand = []
        for at in p.find_indices(ColumnRole.SLOPE):
            part = parts[p.labels[at].part]
            low, high = find_size_range(part.id, self.model.machine)
            if (part.size <= low and fit.amplitude[at] < 0.0) or (
                part.size >= high and fit.amplitude[at] > 0.0
            ):
                stand.append(at)
        if not stand:
            return p, fit
        free = np.setdiff1d(np.arange(count), stand)
        inside = choose_better_fit(p, free, fit.noise, self.model.channels)
        amplitude, covariance = np.zeros(count), fit.covariance.copy()
        amplitude[free], covariance[np.ix_(free, free)] = inside.amplitude, inside.covariance
        return p, inside._replace(amplitude=amplitude, covariance=covariance)

    def _fit_at_rerun_sizes(
        self, found: FittedHypothesis, p: Problem, fit: Fit
    ) -> FittedHypothesis:
        """Return the hypothesis with the likelihood of the sizes with which the model was run."""
        held = np.setdiff1d(np.arange(len(fit.amplitude)), p.find_indices(ColumnRole.SLOPE))
        there = choose_better_fit(p, held, found.noise, self.model.channels)
        lost = fit.log_likelihood - there.log_likelihood
        return found._replace(
            log_likelihood=there.log_likelihood,
            noise=there.noise,
            log_evidence=found.log_evidence - lost,
        )

    def _calc_collinearity(self, p: Problem, noise: dict[str, Noise]) -> float:
        """Return the largest cosine between two effects' traces, orthogonal to the nuisances, with
        the catalogue's forms."""
        places = p.find_indices(ColumnRole.SLOPE)
        if len(places) < 2:
            return 0.0
        part = (
            project_out_fixed(p, np.arange(p.labels.index(p.labels[places[0]])), noise)
            .select_columns(np.array(places))
            .A
        )
        scale = np.sqrt(np.maximum(np.diag(part), 1e-300))
        return float((np.abs(part) / scale[:, None] / scale - np.eye(len(places))).max())

    def _move_threshold(self, found: FittedHypothesis) -> FittedHypothesis:
        """Move a threshold in decreasing steps to its best fit, and return the hypothesis with the
        threshold's interval.

        A threshold acts on the given commands, so all values between two commands fit equally well.
        """
        k = next(k for k, part in enumerate(found.parts) if EFFECT_ROWS[part.id].threshold)
        part = found.parts[k]
        edges = self._list_commands_between(*find_size_range(part.id, self.model.machine))
        tried: dict[int, FittedHypothesis] = {}

        def value(place: int) -> float:
            if place not in tried:
                tried[place] = self._fit_at_size(
                    found, k, 0.5 * float(edges[place] + edges[place + 1])
                )
            return tried[place].log_likelihood

        last = len(edges) - 2
        here, first = int(np.clip(np.searchsorted(edges, part.size) - 1, 0, last)), 2
        course = f"{part.id} {part.onset_s}"
        # A plateau has no slope, so the whole range is searched once.
        if course not in self._all_over:
            self._all_over.add(course)
            places = np.unique(np.linspace(0, last, THRESHOLD_COUNT).astype(int)).tolist()
            here = max([here, *places, self._find_standing_edge(edges, part.onset_s)], key=value)
            first = max(1, last // THRESHOLD_COUNT)
        here = climb_to_best(
            here,
            value,
            lambda place, step: [
                near for near in (place - int(step), place + int(step)) if 0 <= near <= last
            ],
            [first >> halvings for halvings in range(first.bit_length())],
        )
        as_good = [place for place in tried if value(place) > value(here) - 0.5 * INTERVAL_DROP]
        low, high = float(edges[min(as_good)]), float(edges[max(as_good) + 1])
        best = tried[here]
        lowest, highest = find_size_range(part.id, self.model.machine)
        best = best._replace(
            log_evidence=best.log_evidence + float(np.log((high - low) / (highest - lowest)))
        )
        return best._replace(
            parts=replace_part(best.parts, k, part._replace(size=0.5 * (low + high))),
            sd=(*best.sd[:k], 0.5 * (high - low) / TWO_SIDED_90_QUANTILE, *best.sd[k + 1 :]),
        )

    def refine_delays(self, found: FittedHypothesis) -> FittedHypothesis:
        """Move each delay of a hypothesis in decreasing steps to its best fit.

        A drive's answers fall between two rows of the log. Where all answers pass a row at the same
        delay, the likelihood jumps and has no useful slope.
        """
        best = found
        for k, part in enumerate(found.parts):
            if not EFFECT_ROWS[part.id].trial_sizes or EFFECT_ROWS[part.id].threshold:
                continue
            low, high = find_size_range(part.id, self.model.machine)

            def near(
                now: FittedHypothesis, step: float, k: int = k, low: float = low, high: float = high
            ) -> Iterator[FittedHypothesis]:
                for size in (now.parts[k].size - step, now.parts[k].size + step):
                    yield self._fit_at_size(now, k, float(np.clip(size, low, high)))

            first = (
                FIRST_STEP_ROW_SHARE
                * self.model.find_channel(EFFECT_ROWS[part.id].channels[0]).grid.step_s
            )
            halvings = int(
                np.ceil(np.log2(first / max(LAST_STEP_SD * best.sd[k], LAST_STEP_SHARE * first)))
            )
            best = climb_to_best(
                best, find_log_likelihood, near, [first * 0.5**k for k in range(halvings)]
            )
        return best

    def _fit_at_size(self, found: FittedHypothesis, k: int, size: float) -> FittedHypothesis:
        """Return a hypothesis with another size of one effect, its noise refitted and the other
        sizes unchanged."""
        parts = replace_part(found.parts, k, found.parts[k]._replace(size=size))
        _, fit = self._fit_about(parts, found.noise)
        return found._replace(
            parts=parts,
            log_likelihood=fit.log_likelihood,
            noise=fit.noise,
            log_evidence=fit.log_evidence,
        )

    def _find_standing_edge(self, edges: Array, from_s: float | None) -> int:
        """Return the index of the edge that best separates, by least squares, the speeds at which
        the shaft stood from those at which it turned.

        A threshold halfway between two commands would be off by their distance.
        """
        channel, asked = self.model.find_channel("shaft"), self.model.predict(())["shaft"]
        there = np.flatnonzero(channel.grid.even_s >= (-np.inf if from_s is None else from_s))
        order = there[np.argsort(asked[there])]
        turned = (channel.measured - asked)[order] ** 2
        # Gain in squares when the shaft stands up to this speed.
        gained = np.cumsum(turned - channel.measured[order] ** 2)
        at = np.searchsorted(asked[order], edges, side="right") - 1
        return int(np.clip(np.argmax(np.where(at >= 0, gained[at], 0.0)), 0, len(edges) - 2))

    def _list_commands_between(self, low: float, high: float) -> Array:
        """Return the commanded shaft speeds between two bounds, and the bounds. A quantised reading
        below the first step is zero."""
        shaft = self.model.data.shaft
        low = low if shaft is None else max(low, shaft.step)
        command = np.empty(0) if shaft is None else np.round(shaft.command, 3)
        return np.unique(
            np.concatenate(([low], command[(command > low) & (command < high)], [high]))
        )


def _is_load_telling(channel_names: Collection[str], machine: Machine) -> bool:
    """Tell whether the drive's load separates a closed outlet, which loads the drive, from less
    flow, which unloads it."""
    return "effort" in channel_names and machine.effort.jam > 0.0


def list_candidates(
    channel_names: tuple[str, ...], machine: Machine, heads: int, refilled: bool
) -> list[Candidate]:
    """Return the effects that a scan of a run log with these channels can show; directly detected
    effects are not included."""
    found: list[Candidate] = []
    for effect_id, entry in CATALOGUE.items():
        row = EFFECT_ROWS[effect_id].scale_to_machine(machine)
        if not any(
            kind.startswith("run") and kind != "run with revisited ground"
            for kind in entry.effect.seen_in
        ):
            continue
        # `rename_started_effect` adds these effects.
        if row.found_by is FoundBy.ONSET:
            if not _is_load_telling(channel_names, machine):
                continue
        elif not (row.scanned or row.found_by is FoundBy.DIPS) or not set(row.channels[:1]) & set(
            channel_names
        ):
            continue
        if LogRequirement.REFILL in row.needs and not refilled:
            continue
        low, high = find_size_range(effect_id, machine)
        probe = (
            calc_size_scale(effect_id, machine) * entry.effect.probes[0]
            if row.probe is None
            else row.probe
        )
        if row.trial_sizes:
            found += [
                Candidate(
                    EffectInstance(effect_id, size), max(low, 0.5 * size), min(high, 1.9 * size)
                )
                for size in row.trial_sizes
            ]
        elif entry.effect.member_field:
            found += [
                Candidate(EffectInstance(effect_id, probe, None, k + 1), low, high)
                for k in range(heads)
            ]
        else:
            found.append(Candidate(EffectInstance(effect_id, probe), low, high))
    return found


def is_excited(candidate: Candidate, data: RunData, machine: Machine) -> bool:
    """Tell whether the log excites an effect.

    Missing pulses appear as dips in a fine log (`intermittent`); only in a coarse log is their mean
    the only sign.
    """
    row = EFFECT_ROWS[candidate.part.id]
    if LogRequirement.OPEN_LOOP in row.needs and machine.shaft.regulated > 0.0:
        return False
    if LogRequirement.BOTH_WAYS in row.needs and (
        data.shaft is None or not data.shaft.command.min() < 0.0 < data.shaft.command.max()
    ):
        return False
    if LogRequirement.OFF_ZERO in row.needs and not measure_zero_offset(data.shaft, machine).off:
        return False
    if row.found_by is FoundBy.DIPS and data.speed is not None:
        return float(np.median(np.diff(data.speed.time_s))) > MAX_DIP_STEP_S
    if (
        LogRequirement.FINE_READINGS in row.needs
        and data.shaft is not None
        and data.shaft.step > 0.0
    ):
        return False
    drive = {"shaft": data.shaft, "gate": data.gate}.get(row.stage)
    if row.move_shaped and drive is not None and not drive.moves_seen:
        return False
    opening = data.variables.get("opening_mm")
    if opening is None:
        return LogRequirement.OPENING not in row.needs
    return LogRequirement.OPENINGS not in row.needs or bool(
        np.ptp(np.percentile(opening, (1.0, 99.0)))
        >= scale_nominal(machine, OPENING_RANGE) * MIN_OPENING_RANGE_MM
    )


def _score_added_column(
    p: Problem, at: int, c: Candidate, null: Fit, start: dict[str, Noise], left: ColumnProducts
) -> ScoreTest:
    """Test one candidate column together with the fixed columns, with the noise fitted from `start`
    where the gain may matter."""
    stiff, right, before = left.A[at, at], left.s[at], len(null.amplitude)
    if stiff <= 0.0:
        return ScoreTest(c.part, -np.inf, -np.inf)
    # The trace of a threshold effect is not proportional to its size.
    whole = EFFECT_ROWS[c.part.id].threshold
    size = c.part.size if whole else float(np.clip(right / stiff, c.low, c.high))
    gain = 2.0 * right * size - stiff * size * size
    sd = p.sd.copy()
    sd[at] = find_size_sd(size, p.sd[at])
    spread = 0.5 * float(np.log1p(stiff * sd[at] ** 2)) - find_size_log_weight(size, p.sd[at])
    p = p._replace(sd=sd)
    if gain > MIN_NOISE_FIT_GAIN and not whole:
        full = fit_amplitudes_and_noise(p, np.append(np.arange(before), at), start)
        size = float(np.clip(full.amplitude[-1], c.low, c.high))
        gain = (
            2.0 * (full.log_likelihood - null.log_likelihood)
            if size == full.amplitude[-1]
            else min(gain, 2.0 * (full.log_likelihood - null.log_likelihood))
        )
    elif start is not null.noise and not whole:
        return ScoreTest(c.part, -np.inf, -np.inf)
    return ScoreTest(c.part._replace(size=size), float(gain), 0.5 * float(gain) - spread)


def _step_hypothesis(
    parts: Hypothesis, p: Problem, fit: Fit, machine: Machine
) -> tuple[Hypothesis, tuple[float, ...], float]:
    """Return the hypothesis with fitted sizes, the standard deviation of each, and the largest step
    in its own standard deviation."""
    moved, sd, biggest = list(parts), [0.0] * len(parts), 0.0
    for at in p.find_indices(ColumnRole.SLOPE):
        k = p.labels[at].part
        sd[k] = float(np.sqrt(fit.covariance[at, at]))
        low, high = find_size_range(parts[k].id, machine)
        size = float(np.clip(parts[k].size + fit.amplitude[at], low, high))
        biggest = max(biggest, abs(size - parts[k].size) / max(sd[k], 1e-9))
        moved[k] = parts[k]._replace(size=size)
    return tuple(moved), tuple(sd), biggest

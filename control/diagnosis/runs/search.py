"""The search over hypotheses of one group: candidates scanned by their columns, the best
refitted through the model."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import (
    FLOW_BLOCKED_OUTLET,
    FLOW_GAIN,
    ROWS,
    FoundBy,
    Needs,
    find_size_range,
)
from topdress.control.diagnosis.judgement.evidence import (
    Z90,
    Fit,
    Problem,
    Role,
    adapt_noise,
    choose_better_fit,
    fit_amplitudes_and_noise,
    fit_first_noise,
    limit_slow_noise,
    project_out_fixed,
)
from topdress.control.diagnosis.judgement.gaussian import Gaussian
from topdress.control.diagnosis.judgement.line_search import climb_to_best
from topdress.control.diagnosis.judgement.noise import Noise
from topdress.control.diagnosis.judgement.prior import find_size_log_weight, find_size_sd
from topdress.control.machine.effect import OPENING_RANGE
from topdress.control.machine.machine import CATALOGUE, Machine, calc_size_scale, scale_nominal

from .channels import ChannelSeries
from .columns import WRITTEN, Columns
from .drives import read_off_zero
from .hypothesis import EffectInstance, Hypothesis, replace_part
from .model import GroupModel
from .stages import RunData

Array = npt.NDArray[np.float64]

# cosine of two effects' traces, above which rounding decides what either of them is
MAX_COLLINEARITY = 0.999
# rounds of a refit: the model is run, then sizes are fitted
MAX_ROUNDS = 4
# in s.d. of a size: a refit ends where no size moves by more
SETTLED_SD = 0.05
# gain in twice the log-likelihood from which on the noise is fitted too
FITTED_FROM = 4.0
# from 1st to 99th percentile, for a gate's play and slowness; on the nominal machine
MOVES_MM = 2.0
# a pulse that goes missing shows in rows of this length
DIPS_WITHIN_S = 0.5
# of a row of the log: the first step of a walk ...
WALK_ROWS = 0.5
WALK_TO = 0.5  # ... and of the size's s.d.: the last ...
SMALLEST_WALK = 1e-6  # ... of the first, where that s.d. is 0
THRESHOLDS_TRIED = 16  # places of a threshold, over all commands
# of twice the log-likelihood: 90 % for one size (chi-square, one degree of freedom)
THRESHOLD_GAP = 2.7


class Candidate(NamedTuple):
    """An effect as it is tried: what is added, and between which sizes its amplitude is
    believed."""

    part: EffectInstance
    low: float
    high: float
    usual: float = np.inf  # s.d. of its prior


class ScoreTest(NamedTuple):
    """A candidate as the scan sees it."""

    part: EffectInstance  # with the estimated size
    gain: float  # of twice the log-likelihood
    # of the log evidence, its size and times integrated
    evidence: float = 0.0
    # ... of which its times cost so much: they were not known
    spent: float = 0.0


class FittedHypothesis(NamedTuple):
    """A hypothesis refitted in full."""

    parts: Hypothesis
    sd: tuple[float, ...]  # of the sizes
    log_likelihood: float
    noise: dict[str, Noise]
    collinearity: float = 0.0  # largest correlation between two sizes
    # sizes integrated; priors of the parts and of their times left out
    log_evidence: float = 0.0


def log_likelihood(one: FittedHypothesis) -> float:
    return one.log_likelihood


class Search:
    """A group's model, the columns made of it, and the candidates that are tried on it.

    curves : what gives hypotheses of several effects at once.
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
        self.columns = Columns(self.model)
        refilled = data.hopper is not None and bool(data.hopper.jumps)
        every = list_candidates(self.model.names, machine, self.model.heads, refilled)
        self.candidates = [
            c._replace(usual=ROWS[c.part.id].on(machine).usual)
            for c in every
            if is_excited(c, data, machine)
        ]
        self._all_over: set[str] = set()  # thresholds that were looked for all over

    def scan(self, parts: Hypothesis, noise: dict[str, Noise]) -> list[ScoreTest]:
        """Every candidate added to a refitted hypothesis, best first, one entry per effect and
        member.

        The score test: one step from the hypothesis along the candidate's column; where that
        gains something the noise is fitted along.
        """
        tried = [
            c
            for c in self.candidates
            if ROWS[c.part.id].found_by is not FoundBy.ONSET
            and not any(p.id == c.part.id and p.member == c.part.member for p in parts)
        ]
        p, before = self.columns.compress_hypothesis(
            parts, [self.columns.of_candidate(parts, c.part) for c in tried]
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

    def name_as_started(self, part: EffectInstance) -> EffectInstance:
        """The part by the name that it has where it begins within a run: less flow at once is a
        blocked outlet, where no drive tells its load; where one does, the load tells the two
        apart, and each is a candidate."""
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

    def refit(self, parts: Hypothesis, noise: dict[str, Noise] | None = None) -> FittedHypothesis:
        """Sizes, their s.d. and likelihood of a hypothesis, its model rerun until the sizes
        stand still."""
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
                self._collinearity(p, fit.noise),
                self._calc_form_evidence(p, fit),
            )
            if biggest < SETTLED_SD:
                best = best._replace(parts=moved)
                break
            now = moved
        # a slope leads further than the model goes: what it is worth where it was run
        else:
            best = best and self._calc_run_likelihood(best, p, fit)
        assert best is not None
        return (
            self._move_threshold(best)
            if any(ROWS[part.id].threshold for part in best.parts)
            else best
        )

    def find_noise(self) -> None:
        """The noise that nothing wrong leaves, from which models are fitted."""
        p, count = self.columns.compress_hypothesis(())
        self.model.noise = fit_first_noise(
            p, np.arange(count), self.model.noise, self.model.channels
        )

    def _calc_form_evidence(self, p: Problem, fit: Fit) -> float:
        """Log evidence of a hypothesis whose forms are, at even odds, the catalogue's own or
        free to differ."""
        forms = p.places(Role.FORM)
        if not forms:
            return fit.log_evidence
        stand = np.flatnonzero(fit.amplitude == 0.0)
        exact = fit_amplitudes_and_noise(
            p, np.setdiff1d(np.arange(len(fit.amplitude)), [*forms, *stand]), fit.noise
        )
        return float(np.logaddexp(fit.log_evidence, exact.log_evidence) - np.log(2.0))

    def _fit_about(self, parts: Hypothesis, noise: dict[str, Noise]) -> tuple[Problem, Fit]:
        """The best fit about a hypothesis; a size at its bound that is pulled beyond stands,
        its amplitude 0."""
        p, count = self.columns.compress_hypothesis(parts)
        fit = choose_better_fit(p, np.arange(count), noise, self.model.channels)
        off = [
            k
            for k, label in enumerate(p.labels)
            if label.name == WRITTEN and abs(fit.amplitude[k]) > p.sd[k]
        ]
        if off:
            sd = p.sd.copy()
            sd[off] = np.abs(fit.amplitude[off])
            p = p._replace(sd=sd, log_weight=float(np.sum(np.log(p.sd[off] / sd[off]))))
            fit = choose_better_fit(p, np.arange(count), fit.noise, self.model.channels)
        stand = []
        for at in p.places(Role.SLOPE):
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

    def _calc_run_likelihood(
        self, found: FittedHypothesis, p: Problem, fit: Fit
    ) -> FittedHypothesis:
        """The same, with the likelihood of the sizes that the model was run with."""
        held = np.setdiff1d(np.arange(len(fit.amplitude)), p.places(Role.SLOPE))
        there = choose_better_fit(p, held, found.noise, self.model.channels)
        lost = fit.log_likelihood - there.log_likelihood
        return found._replace(
            log_likelihood=there.log_likelihood,
            noise=there.noise,
            log_evidence=found.log_evidence - lost,
        )

    def _collinearity(self, p: Problem, noise: dict[str, Noise]) -> float:
        """Largest likeness of two parts' traces, nuisances taken out and their forms as the
        catalogue has them."""
        places = p.places(Role.SLOPE)
        if len(places) < 2:
            return 0.0
        part = (
            project_out_fixed(p, np.arange(p.labels.index(p.labels[places[0]])), noise)
            .of(np.array(places))
            .A
        )
        scale = np.sqrt(np.maximum(np.diag(part), 1e-300))
        return float((np.abs(part) / scale[:, None] / scale - np.eye(len(places))).max())

    def _move_threshold(self, found: FittedHypothesis) -> FittedHypothesis:
        """The threshold moved, in ever smaller steps, to where it fits best; its interval is
        what the log leaves open.

        A threshold acts on the commands that were given: between two of them every value is as
        good.
        """
        k = next(k for k, part in enumerate(found.parts) if ROWS[part.id].threshold)
        part = found.parts[k]
        edges = self._commands_between(*find_size_range(part.id, self.model.machine))
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
        if course not in self._all_over:  # a plateau leads nowhere: look all over once
            self._all_over.add(course)
            places = np.unique(np.linspace(0, last, THRESHOLDS_TRIED).astype(int)).tolist()
            here = max([here, *places, self._find_standing_edge(edges, part.onset_s)], key=value)
            first = max(1, last // THRESHOLDS_TRIED)
        here = climb_to_best(
            here,
            value,
            lambda place, step: [
                near for near in (place - int(step), place + int(step)) if 0 <= near <= last
            ],
            [first >> halvings for halvings in range(first.bit_length())],
        )
        as_good = [place for place in tried if value(place) > value(here) - 0.5 * THRESHOLD_GAP]
        low, high = float(edges[min(as_good)]), float(edges[max(as_good) + 1])
        best = tried[here]
        lowest, highest = find_size_range(part.id, self.model.machine)
        best = best._replace(
            log_evidence=best.log_evidence + float(np.log((high - low) / (highest - lowest)))
        )
        return best._replace(
            parts=replace_part(best.parts, k, part._replace(size=0.5 * (low + high))),
            sd=(*best.sd[:k], 0.5 * (high - low) / Z90, *best.sd[k + 1 :]),
        )

    def walk_delays(self, found: FittedHypothesis) -> FittedHypothesis:
        """The hypothesis with each delay walked to where it fits best, in ever smaller steps.

        A drive answers stairs between two rows of the log; where all its answers pass a row at
        once the likelihood leaps, and no slope says so.
        """
        best = found
        for k, part in enumerate(found.parts):
            if not ROWS[part.id].trial_sizes or ROWS[part.id].threshold:
                continue
            low, high = find_size_range(part.id, self.model.machine)

            def near(
                now: FittedHypothesis, step: float, k: int = k, low: float = low, high: float = high
            ) -> Iterator[FittedHypothesis]:
                for size in (now.parts[k].size - step, now.parts[k].size + step):
                    yield self._fit_at_size(now, k, float(np.clip(size, low, high)))

            first = WALK_ROWS * self.model.channel(ROWS[part.id].channels[0]).grid.step_s
            halvings = int(
                np.ceil(np.log2(first / max(WALK_TO * best.sd[k], SMALLEST_WALK * first)))
            )
            best = climb_to_best(
                best, log_likelihood, near, [first * 0.5**k for k in range(halvings)]
            )
        return best

    def _fit_at_size(self, found: FittedHypothesis, k: int, size: float) -> FittedHypothesis:
        """A hypothesis with another size of one part, its noise fitted and the other sizes as
        they are."""
        parts = replace_part(found.parts, k, found.parts[k]._replace(size=size))
        _, fit = self._fit_about(parts, found.noise)
        return found._replace(
            parts=parts,
            log_likelihood=fit.log_likelihood,
            noise=fit.noise,
            log_evidence=fit.log_evidence,
        )

    def _find_standing_edge(self, edges: Array, from_s: float | None) -> int:
        """Place of the edge that best parts the speeds at which the shaft stood, though asked,
        from those at which it turned, by least squares: a threshold between two of its commands
        misses it by all that they are apart."""
        channel, asked = self.model.channel("shaft"), self.model.predicted(())["shaft"]
        there = np.flatnonzero(channel.grid.even_s >= (-np.inf if from_s is None else from_s))
        order = there[np.argsort(asked[there])]
        turned = (channel.measured - asked)[order] ** 2
        # by a shaft that stands up to here
        gained = np.cumsum(turned - channel.measured[order] ** 2)
        at = np.searchsorted(asked[order], edges, side="right") - 1
        return int(np.clip(np.argmax(np.where(at >= 0, gained[at], 0.0)), 0, len(edges) - 2))

    def _commands_between(self, low: float, high: float) -> Array:
        """The shaft speeds that were asked for between two bounds, and the bounds. What is read
        in steps is read as nothing below the first."""
        shaft = self.model.data.shaft
        low = low if shaft is None else max(low, shaft.step)
        command = np.empty(0) if shaft is None else np.round(shaft.command, 3)
        return np.unique(
            np.concatenate(([low], command[(command > low) & (command < high)], [high]))
        )


def _is_load_telling(channel_names: Collection[str], machine: Machine) -> bool:
    """Whether the drive tells a closed outlet, which loads it, from less flow, which unloads it."""
    return "effort" in channel_names and machine.effort.jam > 0.0


def list_candidates(
    channel_names: tuple[str, ...], machine: Machine, heads: int, refilled: bool
) -> list[Candidate]:
    """Effects that a run log with these channels can show by a scan; those read off the data
    come from elsewhere."""
    found: list[Candidate] = []
    for effect_id, entry in CATALOGUE.items():
        row = ROWS[effect_id].on(machine)
        if not any(
            kind.startswith("run") and kind != "run with revisited ground"
            for kind in entry.effect.seen_in
        ):
            continue
        if row.found_by is FoundBy.ONSET:  # `name_as_started`
            if not _is_load_telling(channel_names, machine):
                continue
        elif not (row.scanned or row.found_by is FoundBy.DIPS) or not set(row.channels[:1]) & set(
            channel_names
        ):
            continue
        if Needs.REFILL in row.needs and not refilled:
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
    """Whether the log moves what the effect needs to be moved.

    Missing pulses show as dips where the log is fine enough (`intermittent`); only a coarse log
    shows nothing but their mean.
    """
    row = ROWS[candidate.part.id]
    if Needs.OPEN_LOOP in row.needs and machine.shaft.regulated > 0.0:
        return False
    if Needs.BOTH_WAYS in row.needs and (
        data.shaft is None or not data.shaft.command.min() < 0.0 < data.shaft.command.max()
    ):
        return False
    if Needs.OFF_ZERO in row.needs and not read_off_zero(data.shaft, machine).off:
        return False
    if row.found_by is FoundBy.DIPS and data.speed is not None:
        return float(np.median(np.diff(data.speed.time_s))) > DIPS_WITHIN_S
    if Needs.FINE_READINGS in row.needs and data.shaft is not None and data.shaft.step > 0.0:
        return False
    drive = {"shaft": data.shaft, "gate": data.gate}.get(row.stage)
    if row.move_shaped and drive is not None and not drive.moves_seen:
        return False
    opening = data.variables.get("opening_mm")
    if opening is None:
        return Needs.OPENING not in row.needs
    return Needs.OPENINGS not in row.needs or bool(
        np.ptp(np.percentile(opening, (1.0, 99.0)))
        >= scale_nominal(machine, OPENING_RANGE) * MOVES_MM
    )


def _score_added_column(
    p: Problem, at: int, c: Candidate, null: Fit, start: dict[str, Noise], left: Gaussian
) -> ScoreTest:
    """One candidate column along with the fixed ones, its noise fitted from `start` where the
    gain may matter."""
    stiff, right, before = left.A[at, at], left.s[at], len(null.amplitude)
    if stiff <= 0.0:
        return ScoreTest(c.part, -np.inf, -np.inf)
    # half a threshold's column is not what half a threshold does
    whole = ROWS[c.part.id].threshold
    size = c.part.size if whole else float(np.clip(right / stiff, c.low, c.high))
    gain = 2.0 * right * size - stiff * size * size
    sd = p.sd.copy()
    sd[at] = find_size_sd(size, p.sd[at])
    spread = 0.5 * float(np.log1p(stiff * sd[at] ** 2)) - find_size_log_weight(size, p.sd[at])
    p = p._replace(sd=sd)
    if gain > FITTED_FROM and not whole:
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
    """Hypothesis with the sizes that a fit asks for, the s.d. of each, and the largest step in
    its own s.d."""
    moved, sd, biggest = list(parts), [0.0] * len(parts), 0.0
    for at in p.places(Role.SLOPE):
        k = p.labels[at].part
        sd[k] = float(np.sqrt(fit.covariance[at, at]))
        low, high = find_size_range(parts[k].id, machine)
        size = float(np.clip(parts[k].size + fit.amplitude[at], low, high))
        biggest = max(biggest, abs(size - parts[k].size) / max(sd[k], 1e-9))
        moved[k] = parts[k]._replace(size=size)
    return tuple(moved), tuple(sd), biggest

"""Writes the published result of a diagnosis: channels, causes, effects that the log could not
show, verdict.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit
from topdress.control.diagnosis.effect_cost import calc_consequence
from topdress.control.diagnosis.effects import (
    CANOPY_HEAD_FOULED,
    EFFECT_ROWS,
    FLOW_GAIN,
    GATE_OFFSET,
    SHAFT_GAIN,
    SHAFT_SECOND_ORDER,
    SPEED_WHEEL_RADIUS,
)
from topdress.control.diagnosis.extend import find_free_id
from topdress.control.diagnosis.judgement.evidence import TWO_SIDED_90_QUANTILE, project_out_fixed
from topdress.control.diagnosis.judgement.prior import (
    MIN_LISTED_PROB,
    MIN_NAMED_PROB,
    SEPARATION_SD,
    SIZE_ERROR,
    calc_detectable_size,
    calc_log_prior_odds,
)
from topdress.control.diagnosis.result import (
    UNKNOWN,
    Cause,
    Channel,
    DetectableSize,
    Diagnosis,
    Gain,
    NextRun,
    Rival,
    Size,
    SourceSummary,
    TermFound,
    UnexplainedCurve,
    UnexplainedStructure,
    UnnamedEffect,
    Verdict,
)
from topdress.control.experiments.experiment import Experiment, choose_experiments
from topdress.control.experiments.manoeuvres import Columns, list_manoeuvres
from topdress.control.machine.effect import HOPPER_CAPACITY
from topdress.control.machine.machine import (
    CATALOGUE,
    Machine,
    describe_unit,
    find_size_bounds,
    scale_nominal,
)
from topdress.control.machine.shaft import calc_step_response

from .channels import make_channels
from .cost import calc_field_cost
from .findings import (
    calc_unit_probability,
    find_row_shift_probability,
    is_steady_part,
    note_doubted_rows,
    note_other_dynamics,
)
from .gain import calc_size_spread, measure_gain
from .hypothesis import EffectInstance, make_schedule
from .intermittent import DirectDetection
from .log import clean_run_log
from .model import CHANNEL_GROUPS, calc_equivalent_sd
from .nominal_values import calc_total_sd
from .onset import find_stop_interval
from .residual_analysis import (
    ResidualStructure,
    calc_unknown_prob,
    describe_louder_channels,
    find_residual_structure,
)
from .search import Candidate, Search
from .selection import GroupResult
from .stages import RunData, make_run_data
from .terms import FittedTerm, average_along, average_marginal

Array = npt.NDArray[np.float64]
# Window over which the flow is estimated from the scale, s.
FLOW_WINDOW_S = 10.0
# A rise of the reading over a window by more than this, kg, is a refill, on the nominal machine.
MIN_REFILL_RISE_KG = 1.0
# The factor or offset error that every log of a channel should show.
BASIC_EFFECTS = {
    "shaft": SHAFT_GAIN.id,
    "gate": GATE_OFFSET.id,
    "flow": FLOW_GAIN.id,
    "speed": SPEED_WHEEL_RADIUS.id,
    "heads": CANOPY_HEAD_FOULED.id,
}


def find_separating_run(causes: Sequence[Cause], machine: Machine) -> NextRun | None:
    """Return the shortest manoeuvre that separates the worst pair of rivals; the effect's own
    experiment where no manoeuvre does."""
    doubtful = [c for c in causes if c.rivals]
    if not doubtful:
        return None
    cause = max(doubtful, key=lambda c: c.rivals[0].probability)
    rival = cause.rivals[0].id
    value = cause.size.value or EFFECT_ROWS[cause.id].probe or 1.0
    every = list_manoeuvres(machine)
    apart = np.array(
        [
            [
                find_separation(
                    one, machine, EffectInstance(cause.id, value, None, cause.member), rival
                )
                for one in every
            ]
        ]
    )
    best = choose_experiments(apart, [one.minutes for one in every], SEPARATION_SD, 1).tests
    why = f"this data cannot tell {cause.id} from {', '.join(r.id for r in cause.rivals)}"
    if not best:
        return NextRun(why, CATALOGUE[cause.id].effect.separate)
    run = every[best[0]]
    return NextRun(why, run.plan, run.id, run.minutes, run.steps)


def find_separation(
    manoeuvre: Experiment[Columns], machine: Machine, part: EffectInstance, rival_id: str
) -> float:
    """Return the norm of an effect's trace, in standard deviations, after its rival was fitted to
    the manoeuvre's log."""
    log = clean_run_log(manoeuvre.predict(machine))
    data = make_run_data(log, machine)
    seen = make_channels(data, machine)
    names = next(
        names for names in CHANNEL_GROUPS.values() if EFFECT_ROWS[part.id].channels[0] in names
    )
    members = [seen[n] for n in names if n in seen]
    if not members:
        return 0.0
    search = Search(members, machine, data)
    wanted = [c for c in search.candidates if c.part.id in (part.id, rival_id)]
    if {c.part.id for c in wanted} != {part.id, rival_id}:
        return 0.0
    own = min(
        (c for c in wanted if c.part.id == part.id), key=lambda c: abs(c.part.size - part.size)
    )
    other = next(c for c in wanted if c.part.id == rival_id)
    p, before = search.columns.compress_hypothesis(
        (), [search.columns.make_candidate_column((), c.part) for c in (other, own)]
    )
    left = project_out_fixed(p, np.arange(before + 1), search.model.noise).A[-1, -1]
    return float(abs(part.size) * np.sqrt(max(0.0, left)))


def make_channel_rows(one: GroupResult, data: RunData) -> list[Channel]:
    """Build the result's channels of one group; the scale's reading gives both flow and scale."""
    left = one.search.model.calc_residual(())
    found: list[Channel] = []
    for channel in one.search.model.channels:
        residual, measured = left[channel.name], channel.measured
        noise = one.found.noise[channel.name]
        floor = float(np.hypot(noise.fast_sd, channel.prior.floor_sd))
        p = one.p_nothing
        if channel.name == "scale":
            found.append(
                _make_flow_channel(
                    channel.grid.even_s,
                    measured,
                    residual,
                    noise.fast_sd,
                    p,
                    data,
                    scale_nominal(one.search.model.machine, HOPPER_CAPACITY) * MIN_REFILL_RISE_KG,
                )
            )
            residual = residual - np.median(residual[:10])
        spread = float(np.var(measured))
        found.append(
            Channel(
                channel.name,
                channel.unit,
                len(residual),
                float(residual.mean()),
                float(np.sqrt(np.mean(residual**2))),
                floor,
                float(1.0 - np.var(residual) / spread) if spread > 0.0 else 0.0,
                p,
            )
        )
    return found


def _make_flow_channel(
    time_s: Array,
    reading: Array,
    residual: Array,
    noise_kg: float,
    p: float,
    data: RunData,
    rise_kg: float,
) -> Channel:
    """Build the flow channel from decrements of the scale over FLOW_WINDOW_S of working time."""
    step = float(time_s[1] - time_s[0])
    hop = max(1, int(round(FLOW_WINDOW_S / step)))
    working = np.interp(time_s, data.time_s, data.working)
    level = np.arange(0, len(reading) - hop, hop)
    on = np.array(
        [
            working[k : k + hop].mean() > 0.8 and reading[k + hop] - reading[k] < rise_kg
            for k in level
        ],
        bool,
    )
    if not on.any():
        return Channel("flow", "kg/s", 0, 0.0, 0.0, 0.0, 0.0, p)
    span_s = hop * step
    measured = -(reading[level + hop] - reading[level])[on] / span_s
    wrong = -(residual[level + hop] - residual[level])[on] / span_s
    spread = float(np.var(measured))
    return Channel(
        "flow",
        "kg/s",
        len(measured),
        float(wrong.mean()),
        float(np.sqrt(np.mean(wrong**2))),
        float(np.sqrt(2.0) * noise_kg / span_s),
        float(1.0 - np.var(wrong) / spread) if spread > 0.0 else 0.0,
        p,
    )


class _UnnamedCandidates(NamedTuple):
    """Candidates of a group that were not named, (k,), and the information of the log on the size
    of each: inverse variance (k,)."""

    search: Search
    candidates: list[Candidate]
    information: list[float]


def _list_open_columns(one: GroupResult) -> _UnnamedCandidates:
    search, now = one.search, one.found
    named = {p.id for p in now.parts}
    kept = [c for c in search.candidates if c.part.id not in named]
    p, before = search.columns.compress_hypothesis(
        now.parts, [search.columns.make_candidate_column(now.parts, c.part) for c in kept]
    )
    return _UnnamedCandidates(
        search,
        kept,
        np.diag(project_out_fixed(p, np.arange(before), now.noise).A)[before:].tolist(),
    )


def _list_not_shown(left: _UnnamedCandidates) -> list[UnnamedEffect]:
    """Return the smallest size at which each unnamed effect would have been named (Fisher
    information)."""
    search = left.search
    best: dict[str, float] = {}
    odds = calc_log_prior_odds("steady", len({c.part.id for c in search.candidates}))
    for candidate, known in zip(left.candidates, left.information, strict=True):
        size = _find_detectable_size(candidate, known, search.model.machine, odds)
        best[candidate.part.id] = min(size, best.get(candidate.part.id, np.inf))
    found = []
    for effect_id in dict.fromkeys(c.part.id for c in left.candidates):
        machine, size = search.model.machine, best.get(effect_id, np.inf)
        most = max(map(abs, find_size_bounds(effect_id, machine)))
        found.append(
            UnnamedEffect(
                effect_id,
                DetectableSize(size if size <= most else None, describe_unit(effect_id, machine)),
            )
        )
    return found


def _list_uninformed_effects(left: _UnnamedCandidates) -> list[str]:
    """Return the basic effects on whose size the log has less information than the prior (`usual`).

    The absence of such an effect is then a statement of the prior, not of the log.
    """
    return [
        c.part.id
        for c, known in zip(left.candidates, left.information, strict=True)
        if c.part.id in BASIC_EFFECTS.values() and known * c.usual**2 < 1.0
    ]


def _find_detectable_size(
    candidate: Candidate, information: float, machine: Machine, odds: float
) -> float:
    """Return the smallest size that would be named with a probability of 0.9; inf where this column
    cannot show the effect."""
    part, row = candidate.part, EFFECT_ROWS[candidate.part.id]
    if CATALOGUE[part.id].effect.onset_only or information <= 0.0:
        return np.inf
    size = calc_detectable_size(
        candidate.usual, 1.0 / (1.0 / information + calc_equivalent_sd(part.id, machine) ** 2), odds
    )
    if row.threshold:
        size = abs(part.size) if size <= abs(part.size) else np.inf
    return np.inf if row.trial_sizes and size > abs(part.size) * 2.0 else size


def make_report(
    data: RunData,
    machine: Machine,
    judged: Sequence[GroupResult],
    read_off: Sequence[DirectDetection],
    path: str,
    findings: tuple[str, ...],
) -> Diagnosis:
    """Build the published result. read_off : effects that were removed from the data before the
    search."""
    rows = [row for one in judged for row in make_channel_rows(one, data)]
    gains: list[Gain] = []
    causes: list[Cause] = []
    unexplained: list[UnexplainedStructure] = []
    for one in judged:
        rest = find_residual_structure(
            one, {name for each in read_off for name in EFFECT_ROWS[each.part.id].channels}
        )
        doubt = (
            calc_unit_probability(data.shaft, machine) if "shaft" in one.search.model.names else 0.0
        )
        varies = calc_size_spread(one)
        by_rows = [
            find_row_shift_probability(part, sd, data, machine)
            for part, sd in zip(one.found.parts, one.found.sd, strict=True)
        ]
        named = [
            _make_cause(
                one,
                k,
                float(np.hypot(sd, varies.get(k, 0.0))),
                machine,
                data,
                max(
                    calc_unknown_prob(one, k, rest),
                    doubt * is_steady_part(part),
                    by_rows[k],
                ),
            )
            for k, (part, sd) in enumerate(zip(one.found.parts, one.found.sd, strict=True))
        ]
        findings = (*findings, *note_doubted_rows(by_rows))
        named = [cause for cause in named if cause.probability > MIN_LISTED_PROB or not rest]
        causes += named
        unexplained += _list_unexplained(one, rest, rows, bool(named))
        gains += measure_gain(one) if named or not one.found.parts else ()
    causes += [_make_direct_cause(one, machine, data) for one in read_off]
    terms = [(group, found) for group in judged for found in group.terms]
    tables = [table for one in judged for table in _list_smooth_tables(one, data)]
    left = [_list_open_columns(one) for one in judged]
    absent = [
        one
        for each in left
        for one in _list_not_shown(each)
        if one.id not in {r.part.id for r in read_off}
    ]
    hardly = {effect_id for each in left for effect_id in _list_uninformed_effects(each)}
    open_ = [row.channel for row in rows if BASIC_EFFECTS.get(row.channel) in hardly]
    verdict = _choose_verdict(
        [row for row in rows if row.channel not in open_], causes, unexplained
    )
    findings = (
        *findings,
        *(
            sentence
            for name in open_
            if (
                sentence := _describe_cannot_tell(
                    name, absent, {c.id for c in causes}, {one.channel for one in unexplained}
                )
            )
        ),
    )
    findings = (
        *findings,
        *(
            sentence
            for one in judged
            for sentence in (
                *_describe_step_answer(one),
                *describe_louder_channels(one, {each.channel for each in unexplained}),
            )
        ),
    )
    findings = (*findings, *note_other_dynamics(causes, machine))
    excited = {
        word: (float(np.percentile(series, 1.0)), float(np.percentile(series, 99.0)))
        for word, series in data.variables.items()
    }
    return Diagnosis(
        data=SourceSummary(path, "run", data.rows, data.duration_s, machine.id, machine.stages),
        channels=tuple(rows),
        verdict=verdict,
        causes=tuple(
            sorted(causes, key=lambda cause: calc_consequence(cause.field_cost), reverse=True)
        ),
        not_shown=(
            *absent,
            *_list_invisible_effects(
                {c.id for c in causes} | {a.id for a in absent},
                machine,
                {one.name for one in data.efforts},
            ),
        ),
        unexplained=tuple(unexplained),
        next_run=find_separating_run(causes, machine) if verdict == "ambiguous" else None,
        gain=tuple(gains),
        extended_machine=None,
        findings=findings,
        tables=tuple(tables),
        excited=excited,
        terms=_number_equal_terms([_make_term_found(group, found, data) for group, found in terms]),
    )


def _choose_verdict(
    rows: Sequence[Channel], causes: Sequence[Cause], unexplained: Sequence[UnexplainedStructure]
) -> Verdict:
    if unexplained:
        return "unexplained"
    if any(c.rivals or c.probability < MIN_NAMED_PROB for c in causes):
        return "ambiguous"
    if causes:
        return "named"
    return "none" if rows else "not_judged"


def _describe_step_answer(one: GroupResult) -> list[str]:
    """Describe the step response of a second-order shaft."""
    parts = one.found.parts
    if not any(part.id == SHAFT_SECOND_ORDER.id for part in parts):
        return []
    shaft = make_schedule(one.search.model.base, parts).sets[-1].by_name["shaft"]
    if shaft.second_order_s <= 0.0:
        return []
    answer = calc_step_response(shaft)
    if answer.overshoot_percent > 0.0:
        how = (
            f"overshoots by {answer.overshoot_percent:.2g} %, swings with a period of "
            f"{answer.period_s:.2g} s and "
            f"settles with a time constant of {answer.lags_s[0]:.2g} s"
        )
    else:
        how = (
            f"does not overshoot: two time constants, {answer.lags_s[0]:.2g} and "
            f"{answer.lags_s[1]:.2g} s"
        )
    return [f"{SHAFT_SECOND_ORDER.id}: a step of the command {how}"]


def _describe_cannot_tell(
    channel: str,
    absent: Sequence[UnnamedEffect],
    named: Collection[str],
    unexplained: Collection[str],
) -> str:
    """Describe what a log cannot tell of a channel in which no cause was found."""
    said = any(
        EFFECT_ROWS[name].channels[:1] == (channel,) and EFFECT_ROWS[name].scanned for name in named
    )
    if channel in unexplained or said:
        return ""
    one = next(one for one in absent if one.id == BASIC_EFFECTS[channel])
    size = one.smallest_detectable
    least = "at any size" if size.value is None else f"below {size.value:.2g} {size.unit}"
    return (
        f"{channel}: this log is too short, or moves too little, to say that nothing is "
        f"wrong: {one.id} {least} "
        "would not show"
    )


def _list_invisible_effects(
    there: set[str], machine: Machine, shown: Collection[str]
) -> list[UnnamedEffect]:
    """Return effects that this log could not show at any size; those of effort only where a drive
    of this log has an effort column."""
    return [
        UnnamedEffect(effect_id, DetectableSize(None, describe_unit(effect_id, machine)))
        for effect_id, entry in CATALOGUE.items()
        if effect_id not in there
        and (
            EFFECT_ROWS[effect_id].channels[0] in shown
            if entry.stage == "effort"
            else machine.has_stage(entry.stage)
        )
    ]


def _list_unexplained(
    one: GroupResult, rest: Sequence[ResidualStructure], rows: Sequence[Channel], named: bool
) -> list[UnexplainedStructure]:
    """Return the structure of a group that is neither noise nor named: its smooth dependence, or
    else the residual structure of its channels."""
    by_name = {row.channel: row for row in rows}
    if one.terms:
        return [
            UnexplainedStructure(
                term.stage,
                variable,
                term.explained_share,
                by_name[term.stage].rmse,
                by_name[term.stage].noise_floor,
                by_name[term.stage].unit,
                term.field_percent,
            )
            for term in one.terms
            for variable in term.tried.over
        ]
    if named:
        # The named causes are then doubted instead.
        return []
    prior = {c.name: c.prior.fast_sd for c in one.search.model.channels}
    return [
        UnexplainedStructure(
            r.channel,
            r.variable,
            max(0.0, 1.0 - (c.noise_floor / max(c.rmse, 1e-300)) ** 2),
            c.rmse,
            prior[r.channel] if r.why == "loud" else c.noise_floor,
            c.unit,
            None,
            r.hint,
            None,
            r.period_s,
        )
        for r in rest
        for c in (by_name[r.channel],)
    ]


def _list_smooth_tables(one: GroupResult, data: RunData) -> list[UnexplainedCurve]:
    """Return a smooth curve for each variable of each term: the partial dependence of the term on
    the variable."""
    return [
        UnexplainedCurve(term.stage, variable, *average_marginal(term.term, variable, data))
        for term in one.terms
        for variable in term.tried.over
    ]


def _make_term_found(group: GroupResult, found: FittedTerm, data: RunData) -> TermFound:
    search, now = group.search, group.found
    gain = None if found.tried.kind.one_run else found.held_out
    plain = found.term.model_copy(update={"held_out_gain": gain}).model_dump(mode="json")
    return TermFound(
        plain,
        found.stage,
        found.term.unit,
        found.explained_share,
        found.field_percent,
        found.gain,
        gain,
        average_along(search, now, found, data),
    )


def _number_equal_terms(terms: Sequence[TermFound]) -> tuple[TermFound, ...]:
    """Give terms of the same form over the same variable distinct ids, as a machine file does."""
    found: list[TermFound] = []
    for one in terms:
        name = find_free_id(one.term["id"], [other.term["id"] for other in found])
        found.append(replace(one, term={**one.term, "id": name}))
    return tuple(found)


def _make_direct_cause(seen: DirectDetection, machine: Machine, data: RunData) -> Cause:
    effect = CATALOGUE[seen.part.id].effect
    half = TWO_SIDED_90_QUANTILE * SIZE_ERROR * seen.sd
    low, high = max(0.0, seen.part.size - half), seen.part.size + half
    size = Size(seen.part.size, low, high, describe_unit(seen.part.id, machine))
    return Cause(
        seen.part.id,
        size,
        seen.part.onset_s,
        float(expit(seen.log_odds)),
        (),
        None,
        effect.advice,
        calc_field_cost(seen.part, machine, data),
    )


def _make_cause(
    one: GroupResult, k: int, sd: float, machine: Machine, data: RunData, left: float
) -> Cause:
    """Build a cause. sd : standard deviation of the effect's size. left : probability that the true
    cause is a different one, by the residual of the whole model."""
    part, place = one.found.parts[k], one.places[k]
    entry = CATALOGUE[part.id]
    unit = describe_unit(part.id, machine)
    if entry.effect.onset_only:
        size = Size(part.onset_s, *find_stop_interval(one.search.model, part), unit)
    else:
        sd = calc_total_sd(part, sd, machine)
        low, high = part.size - TWO_SIDED_90_QUANTILE * sd, part.size + TWO_SIDED_90_QUANTILE * sd
        size = Size(part.size, low, high, unit)
    known = place.calc_probabilities(left)
    instead = [
        *((r.part.id, p) for r, p in zip(place.rivals, known.rivals, strict=True)),
        (UNKNOWN, known.unknown),
    ]
    rivals = tuple(
        Rival(name, p) for name, p in instead if p > MIN_LISTED_PROB and known.part < MIN_NAMED_PROB
    )
    return Cause(
        part.id,
        size,
        part.onset_s,
        known.part,
        rivals,
        part.member,
        entry.effect.advice,
        calc_field_cost(part, machine, data),
        until_s=part.until_s,
        grows=part.grows,
    )

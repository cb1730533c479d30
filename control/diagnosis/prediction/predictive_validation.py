"""Validates a diagnosis by prediction: selects the results that a machine file may adopt, and
corrects the report.

Each group of channels is judged separately, because its stages are predicted from the measured
output of the stages before. Effects of a group were fitted together and are adopted together; where
one is left out the others are refitted.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.extend import (
    extend,
    find_cause_refusal,
    find_term_refusal,
    is_in_drive_fit,
)
from topdress.control.diagnosis.judgement.evidence import TWO_SIDED_90_QUANTILE
from topdress.control.diagnosis.judgement.prior import MIN_NAMED_PROB
from topdress.control.diagnosis.result import (
    UNKNOWN,
    Cause,
    Diagnosis,
    PredictionErrors,
    Rival,
    Size,
    TermFound,
    UnattributedDriveFit,
    UnexplainedStructure,
)
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.diagnosis.runs.model import CHANNEL_GROUPS, calc_equivalent_sd
from topdress.control.diagnosis.runs.nominal_values import MAX_OFFSET_SD
from topdress.control.machine.machine import CATALOGUE, Machine, describe_unit, list_effect_sizes
from topdress.control.machine.terms import Term

from .block_errors import (
    BlockErrors,
    average_by_block,
    calc_block_errors,
    calc_gain_by_block,
    cut_into_blocks,
    is_surely_positive,
    list_added_numbers,
)
from .log_prediction import LogPredictor
from .plain_rival import CHANNEL_STAGES, MAX_REFIT_STEPS, find_rival, fit_machine_file
from .plain_rival import PlainRival as PlainRival

Array = npt.NDArray[np.float64]

# Minimum ratio of mean square errors: a smaller difference does not matter in the field.
MIN_SQUARE_ERROR_RATIO = 1.1
# Minimum difference in units of the sensor's noise by the machine file.
MIN_DIFFERENCE_IN_NOISE_SDS = 1.0
# Minimum difference in standard errors: 95 % of Student's t for eight blocks.
MIN_STANDARD_ERRORS = 1.9
# Maximum probability of a named cause where a model without the cause predicts clearly better.
MAX_RIVALLED_PROB = 0.5

NO_OFFSETS: Mapping[str, float] = {}

JOINT_FIT_TEXT = (
    "without what is left out it predicts this log no better than before: they were fitted together"
)
NO_GAIN_TEXT = "the log itself is predicted no better with it"


class AdoptablePart(NamedTuple):
    """Adoptable part of a diagnosis. found : the diagnosis with the adopted results and their
    sizes.

    refused : (id, reason) of the chosen causes that are not adopted. predicted : errors by channel,
    of the file and of the compared models.
    """

    found: Diagnosis
    refused: tuple[tuple[str, str], ...]
    predicted: tuple[PredictionErrors, ...] = ()


class _TriedFile(NamedTuple):
    """A trial file for a group. causes, terms : adopted results with their sizes."""

    causes: tuple[Cause, ...]
    terms: tuple[TermFound, ...]
    fitted: UnattributedDriveFit | None
    file: Machine
    held: BlockErrors


def select_predictive_causes(
    on_log: LogPredictor, found: Diagnosis, chosen: Collection[str], read_off: Collection[str]
) -> AdoptablePart:
    """Return the chosen causes (by id) with the diagnosis' terms, as far as the file with them
    predicts better than the file without.

    read_off : ids of effects that were removed from the log before it was judged.
    """
    kept = replace(
        found,
        causes=tuple(
            one
            for one in found.causes
            if one.id in chosen and one.id in read_off and not find_cause_refusal(one)
        ),
        terms=(),
        fitted=None,
    )
    refused: list[tuple[str, str]] = []
    said: list[PredictionErrors] = []
    for channels in _group_channels(on_log):
        own = _list_own_causes(found, channels, read_off)
        every = [one for one in own if not find_cause_refusal(one)]
        terms = tuple(
            one
            for one in found.terms
            if _find_channel_of(one.stage) in channels and not find_term_refusal(one)
        )
        whole = (
            found.fitted if found.fitted is not None and found.fitted.channel in channels else None
        )
        of_rival = {_find_channel_of(one.stage) for one in terms if one.predicts_best}
        every = [
            one
            for one in every
            if not is_in_drive_fit(found, one) and EFFECT_ROWS[one.id].channels[0] not in of_rival
        ]
        picked = tuple(one for one in every if one.id in chosen)
        if not picked and not terms and whole is None:
            continue
        usual, best = _find_best_file(
            on_log, found, channels, picked, terms, whole, refit=len(picked) < len(every)
        )
        if best is None:
            refused += [
                (one.id, JOINT_FIT_TEXT if len(picked) < len(every) else NO_GAIN_TEXT)
                for one in picked
            ]
            continue
        kept = replace(
            kept,
            causes=(*kept.causes, *best.causes),
            terms=(*kept.terms, *best.terms),
            fitted=kept.fitted or best.fitted,
        )
        said += [
            PredictionErrors(name, on_log.find_unit(name), usual[name] ** 0.5, best.held.rms[name])
            for name in channels
        ]
    order = [cause.id for cause in found.causes]
    kept = replace(kept, causes=tuple(sorted(kept.causes, key=lambda cause: order.index(cause.id))))
    return AdoptablePart(kept, tuple(refused), tuple(said))


def validate_prediction(
    on_log: LogPredictor, found: Diagnosis, read_off: Collection[str]
) -> Diagnosis:
    """Compare a diagnosis with the predictions of its file and of the plain rival, and correct the
    report."""
    decided = [
        one.id for one in found.causes if one.probability >= MIN_NAMED_PROB and not one.rivals
    ]
    taken = select_predictive_causes(on_log, found, decided, read_off)
    worse = {name for name, _ in taken.refused}
    kept = {one.term["id"] for one in taken.found.terms}
    found = replace(
        found,
        causes=tuple(
            _limit_probability(one, MAX_RIVALLED_PROB) if one.id in worse else one
            for one in found.causes
        ),
        terms=tuple(
            one
            if one.term["id"] in kept or find_term_refusal(one)
            else replace(one, refused=NO_GAIN_TEXT)
            for one in found.terms
        ),
    )
    predicted, left = [], [*found.unexplained]
    findings = [f"{name}: {why}: it is only suspected" for name, why in taken.refused]
    for channel in (name for channels in _group_channels(on_log) for name in channels):
        found, one, more = _compare_with_rival(on_log, found, taken.found, channel, read_off)
        predicted.append(one)
        left += [
            each
            for each in more
            if not any((each.channel, each.variable) == (old.channel, old.variable) for old in left)
        ]
        findings += [_describe_lead(one)] if more else []
    verdict = found.verdict
    if len(left) > len(found.unexplained):
        verdict = "unexplained"
    elif worse and verdict == "named":
        verdict = "ambiguous"
    return replace(
        found,
        verdict=verdict,
        unexplained=tuple(left),
        predicted=tuple(predicted),
        findings=(*found.findings, *findings),
    )


# The following functions select the content of a file.


def _group_channels(on_log: LogPredictor) -> list[tuple[str, ...]]:
    found = [
        tuple(name for name in names if name in on_log.seen) for names in CHANNEL_GROUPS.values()
    ]
    return [one for one in found if one]


def _list_own_causes(
    found: Diagnosis, channels: Collection[str], read_off: Collection[str]
) -> list[Cause]:
    return [
        one
        for one in found.causes
        if EFFECT_ROWS[one.id].channels[:1]
        and EFFECT_ROWS[one.id].channels[0] in channels
        and one.id not in read_off
    ]


def _find_channel_of(stage: str) -> str:
    return next((channel for channel, name in CHANNEL_STAGES.items() if name == stage), stage)


def _find_best_file(
    on_log: LogPredictor,
    found: Diagnosis,
    channels: tuple[str, ...],
    causes: tuple[Cause, ...],
    terms: tuple[TermFound, ...],
    whole: UnattributedDriveFit | None,
    refit: bool,
) -> tuple[dict[str, float], _TriedFile | None]:
    """Return the simplest trial file within one standard error of the best, among no change, the
    causes alone, and causes with terms.

    The file is None where that is no change, or where any channel of the log is predicted worse.
    refit : whether a jointly fitted effect is left out. The mean square errors of the log's own
    file are returned as well.
    """
    nothing = calc_block_errors(on_log, on_log.machine, channels, ())
    usual = {name: rms**2 for name, rms in nothing.rms.items()}
    of_rival = whole is not None or any(one.predicts_best for one in terms)
    sets = (
        [(causes, terms)] if of_rival or not (causes and terms) else [(causes, ()), (causes, terms)]
    )
    tried = []
    for some, more in sets:
        one = _try_file(on_log, found, channels, some, more, whole, refit, usual)
        tried += [one] if one is not None else []
    every = [nothing, *(one.held for one in tried)]
    least = min(
        every,
        key=lambda one: sum(
            float(one.blocks[name].mean()) / max(1e-300, usual[name]) for name in channels
        ),
    )
    place = next(
        k
        for k, one in enumerate(every)
        if not is_surely_positive(calc_gain_by_block(least, one, usual))
    )
    if place == 0 or any(tried[place - 1].held.rms[name] > nothing.rms[name] for name in channels):
        return usual, None
    return usual, tried[place - 1]


def _try_file(
    on_log: LogPredictor,
    found: Diagnosis,
    channels: tuple[str, ...],
    causes: tuple[Cause, ...],
    terms: tuple[TermFound, ...],
    whole: UnattributedDriveFit | None,
    refit: bool,
    usual: dict[str, float],
) -> _TriedFile | None:
    """Build a trial file as it would be written and read; None where no file may contain it."""
    machine = on_log.machine
    try:
        file = round_trip_machine(
            extend(machine, replace(found, causes=causes, terms=terms, fitted=whole))
        )
        if refit and list_added_numbers(file, machine):
            file = round_trip_machine(fit_machine_file(on_log, channels, file, MAX_REFIT_STEPS))
    except ValueError:
        return None
    numbers = list_added_numbers(file, machine)
    judged = calc_block_errors(on_log, file, channels, numbers, usual)
    if refit:
        sds = {number.name: sd for number, sd in zip(numbers, judged.sd, strict=True)}
        was, now = list_effect_sizes(machine), list_effect_sizes(file)
        causes = tuple(
            _resize_cause(
                one,
                now.get(one.id, CATALOGUE[one.id].neutral)
                - was.get(one.id, CATALOGUE[one.id].neutral),
                sds.get(one.id, 0.0),
            )
            for one in causes
        )
        of_file = {term.id: term for term in file.terms}
        terms = tuple(
            replace(one, term=of_file[one.term["id"]].model_dump(mode="json"))
            if one.term["id"] in of_file
            else one
            for one in terms
        )
    return _TriedFile(causes, terms, whole, file, judged)


def round_trip_machine(machine: Machine) -> Machine:
    """Return a machine file after writing and reading. Raises ValueError for content that no file
    may have."""
    return Machine.model_validate(machine.model_dump(mode="json"))


def _resize_cause(cause: Cause, size: float, sd: float) -> Cause:
    return replace(
        cause,
        size=replace(
            cause.size,
            value=size,
            low=size - TWO_SIDED_90_QUANTILE * sd,
            high=size + TWO_SIDED_90_QUANTILE * sd,
        ),
    )


# The following functions correct the report.


def _compare_with_rival(
    on_log: LogPredictor,
    found: Diagnosis,
    taken: Diagnosis,
    channel: str,
    read_off: Collection[str],
) -> tuple[Diagnosis, PredictionErrors, list[UnexplainedStructure]]:
    """Compare the diagnosis with the plain rival of one channel.

    The rival's file is adopted where it predicts best. Where it predicts clearly better than all
    reported results, no cause is named.
    """
    nothing = calc_block_errors(on_log, on_log.machine, (channel,), ())
    said, file = (
        _calc_errors_of_report(on_log, found, channel, read_off),
        _calc_errors_of_file(on_log, taken, channel),
    )
    usual = {channel: max(1e-300, nothing.rms[channel] ** 2)}
    errors = PredictionErrors(
        channel,
        on_log.find_unit(channel),
        nothing.rms[channel],
        file.rms[channel],
        said.rms[channel],
    )
    own = [
        one
        for one in _list_own_causes(found, (channel,), read_off)
        if EFFECT_ROWS[one.id].channels[0] == channel
    ]
    open_ = bool(own) or any(channel == one.channel for one in found.unexplained)
    if (
        min(said.rms[channel], file.rms[channel]) ** 2
        <= (1.0 + MIN_DIFFERENCE_IN_NOISE_SDS) * on_log.calc_noise(channel) ** 2
    ):
        # No rival can lead by as much as the noise.
        return found, errors, []
    rival = find_rival(on_log, channel)
    if rival is None:
        return found, errors, []
    within = {
        name: MAX_OFFSET_SD * calc_equivalent_sd(name, on_log.machine) for name, _, _ in rival.sizes
    }
    sound = {
        name: float(np.clip(size, -within[name], within[name]))
        for name, size, _ in rival.sizes
        if within[name]
    }
    # A rival that predicts no better than a healthy machine within its tolerances does not lead.
    if sound:
        said = min(
            said,
            _calc_errors_of_report(on_log, found, channel, read_off, sound),
            key=lambda one: one.rms[channel],
        )
        file = file if open_ else min(file, said, key=lambda one: one.rms[channel])
    errors = replace(
        errors,
        rival=rival.held.rms[channel],
        over=rival.variable_names or _COMMAND_VARIABLES.get(channel, ()),
    )
    over_said, over_file = (
        calc_gain_by_block(rival.held, said, usual),
        calc_gain_by_block(rival.held, file, usual),
    )
    noise = MIN_DIFFERENCE_IN_NOISE_SDS * on_log.calc_noise(channel) ** 2 / usual[channel]
    ahead = _is_clear_gain(over_said, said, rival.held, channel) and float(over_said.mean()) > noise
    stands = any(one.id in {cause.id for cause in taken.causes} for one in own) or any(
        _find_channel_of(one.stage) == channel for one in taken.terms
    )
    if not (
        _is_clear_gain(over_file, file, rival.held, channel) and float(over_file.mean()) > noise
        if stands or not open_
        else is_surely_positive(over_file)
    ):
        return found, errors, []
    errors = replace(errors, file=rival.held.rms[channel])
    names = {name for name, _, _ in rival.sizes}
    agree = bool(own) and not rival.terms and {one.id for one in own} <= names
    share = 1.0 - rival.held.rms[channel] ** 2 / max(1e-300, said.rms[channel] ** 2)
    if agree:
        sizes = {name: (size, sd) for name, size, sd in rival.sizes}
        causes = [_resize_cause(one, *sizes[one.id]) if one in own else one for one in found.causes]
    else:
        causes = [
            _limit_probability(one, min(MAX_RIVALLED_PROB, 1.0 - share))
            if one in own and ahead
            else one
            for one in found.causes
        ]
    found = replace(
        found,
        causes=tuple(causes),
        terms=(
            *(one for one in found.terms if _find_channel_of(one.stage) != channel),
            *(_make_term_found(on_log, term, rival, share) for term in rival.terms),
        ),
        fitted=_fit_rival(on_log, rival, nothing) if rival.sizes else found.fitted,
    )
    left = (
        [
            UnexplainedStructure(
                channel, name, share, said.rms[channel], on_log.calc_noise(channel), errors.unit
            )
            for name in errors.over
        ]
        if ahead and not agree
        else []
    )
    return found, errors, left


_COMMAND_VARIABLES = {"shaft": ("shaft_rpm",), "gate": ("opening_mm",)}


def _is_clear_gain(gain: Array, one: BlockErrors, other: BlockErrors, channel: str) -> bool:
    return is_surely_positive(gain, MIN_STANDARD_ERRORS) and one.rms[
        channel
    ] ** 2 > MIN_SQUARE_ERROR_RATIO * float(other.blocks[channel].mean())


def _calc_errors_of_report(
    on_log: LogPredictor,
    found: Diagnosis,
    channel: str,
    read_off: Collection[str],
    sound: Mapping[str, float] = NO_OFFSETS,
) -> BlockErrors:
    """Return the errors of all reported results, including those of this run alone. sound : offsets
    of nominal values within the machine file's tolerances."""
    parts = tuple(
        EffectInstance(
            one.id,
            1.0 if CATALOGUE[one.id].effect.onset_only else one.size.value,
            one.onset_s,
            one.member,
            one.until_s,
            one.grows,
        )
        for one in found.causes
        if one.size.value is not None
        and one.id not in read_off
        and channel in EFFECT_ROWS[one.id].channels
    )
    parts = (*parts, *(EffectInstance(name, size) for name, size in sound.items()))
    terms = tuple(
        Term.model_validate(one.term)
        for one in found.terms
        if _find_channel_of(one.stage) == channel
    )
    machine = on_log.machine.model_copy(update={"terms": (*on_log.machine.terms, *terms)})
    left = on_log.calc_errors(channel, on_log.predict(machine, (channel,), parts)[channel])
    return BlockErrors(
        {channel: float(np.sqrt(np.mean(left**2))) if len(left) else 0.0},
        {channel: average_by_block(left, cut_into_blocks(len(left)))},
    )


def _calc_errors_of_file(on_log: LogPredictor, taken: Diagnosis, channel: str) -> BlockErrors:
    file = extend(on_log.machine, taken)
    return calc_block_errors(
        on_log,
        file,
        (channel,),
        list_added_numbers(file, on_log.machine) if file != on_log.machine else (),
    )


def _limit_probability(cause: Cause, most: float) -> Cause:
    """Limit a cause's probability to `most`; the remainder belongs to an unknown cause."""
    if cause.probability <= most:
        return cause
    rivals = tuple(one for one in cause.rivals if one.id != UNKNOWN)
    return replace(cause, probability=most, rivals=(*rivals, Rival(UNKNOWN, 1.0 - most)))


def _fit_rival(
    on_log: LogPredictor, rival: PlainRival, nothing: BlockErrors
) -> UnattributedDriveFit:
    sizes = tuple(
        (
            name,
            Size(
                size,
                size - TWO_SIDED_90_QUANTILE * sd,
                size + TWO_SIDED_90_QUANTILE * sd,
                describe_unit(name, on_log.machine),
            ),
        )
        for name, size, sd in rival.sizes
    )
    before, after = (float(np.sqrt(one.blocks["shaft"].mean())) for one in (nothing, rival.held))
    return UnattributedDriveFit("shaft", sizes, before, after, on_log.find_unit("shaft"))


def _make_term_found(
    on_log: LogPredictor, term: Term, rival: PlainRival, share: float
) -> TermFound:
    return TermFound(
        term.model_dump(mode="json"), term.stage, term.unit, share, 0.0, 0.0, share, (), True
    )


def _describe_lead(one: PredictionErrors) -> str:
    return (
        f"{one.channel}: least squares over {', '.join(one.over)} predicts this log better "
        "than what is said: "
        f"error {one.said:.3g} -> {one.rival:.3g} {one.unit}; no cause is named by that"
    )

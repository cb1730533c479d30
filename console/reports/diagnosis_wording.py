"""How is a diagnosis worded? Terminal, report, notebook and Diagnosis page use these texts in the
language in use. The module is pure.

Functions take the ids of causes, channels and variables; the caller chooses the facts and their
place.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from topdress.console.locale import N_, _
from topdress.console.reports.number_text import (
    count_decimals,
    format_fixed,
    format_number,
    format_percent,
    format_short,
    use_plain_minus,
)
from topdress.console.reports.variable_names import find_variable
from topdress.control.diagnosis.extend import find_cause_refusal, find_term_refusal, is_in_drive_fit
from topdress.control.diagnosis.result import (
    RUN_CHANNELS,
    UNKNOWN,
    Cause,
    Diagnosis,
    FieldCost,
    Gain,
    Size,
    UnattributedDriveFit,
    UnexplainedStructure,
    UnnamedEffect,
)
from topdress.control.machine.machine import CATALOGUE

# Smallest probability of a cause that a headline names.
MIN_HEADLINE_PROB = 0.5
# Decimals of a place error in metres, i.e. centimetres.
PLACE_DIGITS = 2

# Words of each verdict: in a sentence, as a single word, and as a symbol.
VERDICT_WORDS = {
    "none": ("nothing beyond noise", N_("NOTHING WRONG"), "-"),
    "named": ("named", N_("CAUSE NAMED"), "!"),
    "ambiguous": ("found, but not told apart", N_("NOT TOLD APART"), "?"),
    "unexplained": ("structure that no known effect explains", N_("UNEXPLAINED"), "??"),
    "not_judged": ("not judged", N_("NOT JUDGED"), "??"),
}
# The keys are the channels of the JSON result; only the values are translated.
CHANNEL_NAMES = {
    "shaft": N_("shaft"),
    "gate": N_("gate"),
    "flow": N_("flow"),
    "scale": N_("scale"),
    "speed": N_("speed"),
    "heads": N_("heads"),
    "lag": N_("lag"),
    "place": N_("place"),
    "effort": N_("effort"),
    "gate_effort": N_("gate's effort"),
}


def name_channel(channel: str) -> str:
    """Returns the channel in words."""
    # A channel without an entry here appears under its id.
    return _(CHANNEL_NAMES.get(channel, channel))


def find_effect_title(effect_id: str) -> str:
    """Returns the title of an effect, in the language in use."""
    # The unknown effect has no entry in the catalogue, because it stands for all effects that are
    # missing there.
    if effect_id == UNKNOWN:
        return _("something else")
    entry = CATALOGUE.get(effect_id)
    return _(entry.effect.title) if entry else effect_id


def find_effect_name(effect_id: str) -> str:
    """Returns the id of an effect; the title of the unknown effect."""
    return find_effect_title(effect_id) if effect_id == UNKNOWN else effect_id


def find_cause_title(cause: Cause) -> str:
    """Returns the title of a cause, with the number of its head or outlet."""
    return find_effect_title(cause.id) + ("" if cause.member is None else f" {cause.member}")


def list_rivals(cause: Cause) -> tuple[tuple[str, float], ...]:
    """Returns the rivals of a cause, without the cause itself, likeliest first, each with its
    probability."""
    return tuple(
        sorted(
            ((r.id, r.probability) for r in cause.rivals if r.id != cause.id), key=lambda r: -r[1]
        )
    )


def is_headline(cause: Cause) -> bool:
    """Returns whether a cause is likely enough for a headline; a less likely cause is only
    suspected."""
    # A cause that ties with a rival must not be a headline: the order of both would be arbitrary.
    return cause.probability >= MIN_HEADLINE_PROB and all(
        share < cause.probability for _rival, share in list_rivals(cause)
    )


def sort_headlines(found: Diagnosis) -> Diagnosis:
    """Returns the diagnosis with suspected causes after the others."""
    # sorted() is stable: within each group the order of the probabilities remains.
    return replace(
        found, causes=tuple(sorted(found.causes, key=lambda cause: not is_headline(cause)))
    )


def has_named_rivals(cause: Cause) -> bool:
    """Returns whether the data cannot separate a cause from rivals with a name, so that all of them
    are equals."""
    # The unknown effect is a rival of every cause, so it alone does not make a cause undecided.
    return any(rival != UNKNOWN for rival, _share in list_rivals(cause))


def list_ties(cause: Cause) -> tuple[tuple[str, str], ...]:
    """Returns a cause and its rivals as equals, each with its probability; the data prefer none."""
    own = (find_cause_title(cause), format_percent(cause.probability))
    return (
        (
            own,
            *((find_effect_title(one), format_percent(share)) for one, share in list_rivals(cause)),
        )
        if has_named_rivals(cause)
        else ()
    )


def format_heading(cause: Cause) -> str:
    """Returns the title of a cause, marked if it is only suspected; for equals their number,
    because none of them is a headline before the next run."""
    if has_named_rivals(cause):
        return _("one of these {count}, this data cannot tell which").format(
            count=len(list_ties(cause))
        )
    return (
        find_cause_title(cause)
        if is_headline(cause)
        else _("suspected: {title}").format(title=find_cause_title(cause))
    )


def is_undecided(cause: Cause) -> bool:
    """Returns whether a machine file adopts a cause only if the user selects it by its name."""
    return has_named_rivals(cause) or not is_headline(cause)


def describe_time_span(cause: Cause) -> str:
    """Returns the part of the log with the effect; "" for an effect in the whole log."""
    # A missing end is written as 0 here; the branches below use only the ends that exist.
    begin, end = f"{cause.onset_s or 0.0:.0f}", f"{cause.until_s or 0.0:.0f}"
    if cause.grows:
        size = cause.size
        last = _("its size") if size.value is None else f"{format_short(size.value)} {_(size.unit)}"
        return _("grows from {begin} s on to {size} at the end").format(begin=begin, size=last)
    if cause.until_s is not None:
        return (
            _("until {end} s").format(end=end)
            if cause.onset_s is None
            else _("from {begin} s to {end} s").format(begin=begin, end=end)
        )
    return "" if cause.onset_s is None else _("since {begin} s").format(begin=begin)


def format_size(size: Size) -> str:
    """Returns a size and its 90 % interval."""
    value = _("size not known") if size.value is None else f"{size.value:.3g} {_(size.unit)}"
    return value + (
        ""
        if size.low is None or size.high is None
        else f" (90 %: {size.low:.3g} {_('to')} {size.high:.3g})"
    )


def describe_field_cost(of: FieldCost) -> str:
    """Returns the effect on dose and position without compensation."""
    # None means that the data cannot tell, which differs from an effect of zero.
    if of.rate_error_percent is None and of.place_error_m is None:
        return "not known"
    said = []
    if of.rate_error_percent:
        word = "much" if of.rate_error_percent > 0.0 else "little"
        said.append(f"{format_number(abs(of.rate_error_percent), 2)} % too {word} is spread")
    # An error that rounds to 0.00 m is omitted.
    if of.place_error_m and abs(of.place_error_m) >= 0.5 * 10.0**-PLACE_DIGITS:
        word = "beyond" if of.place_error_m > 0 else "short of"
        said.append(
            f"material lands {format_fixed(abs(of.place_error_m), PLACE_DIGITS)} m {word} its place"
        )
    if of.rate_error_percent is None:
        said.append("dose not known")
    return "; ".join(said) or "nothing in dose or place"


def describe_unexplained(of: UnexplainedStructure, kind: str, column: bool = True) -> str:
    """Returns the part that no effect explains: its size, its time, and the nearest effect.
    `column` adds the name of the column."""
    if of.variable:
        # The kind of data matters: a variable has another name in a bench table than in a run log.
        name = _(find_variable(of.variable, kind).name)
        said = _("{channel} changes with {variable}; none of the known causes fits").format(
            channel=name_channel(of.channel),
            variable=f"{name} ({of.variable})" if column and name != of.variable else name,
        )
    else:
        said = _("{channel} is off by more than chance; none of the known causes fits").format(
            channel=name_channel(of.channel)
        )
    facts = [
        _("that is {share} of the error not yet explained").format(
            share=format_percent(of.explained_share)
        )
    ]
    if of.rms is not None and of.noise is not None:
        # The decimals follow the noise, because digits below the noise carry no information.
        decimals = count_decimals(of.noise if of.noise > 0.0 else of.rms)
        facts.append(
            _("typically off by {rms} {unit}; the sensors alone are off by {noise} {unit}").format(
                rms=use_plain_minus(format_fixed(of.rms, decimals)),
                noise=use_plain_minus(format_fixed(of.noise, decimals)),
                unit=of.unit,
            )
        )
    if of.dose_percent is not None:
        facts.append(
            _("{percent} % of the dose").format(percent=format_short(abs(of.dose_percent), 2))
        )
    if of.from_s is not None:
        facts.append(_("seems to begin at {begin} s").format(begin=f"{of.from_s:.0f}"))
    if of.period_s is not None:
        facts.append(
            _("comes and goes every {period} s").format(period=format_short(of.period_s, 2))
        )
    if of.hint:
        facts.append(_("nearest: {effect}, whose evidence does not hold").format(effect=of.hint))
    return f"{said}: {'; '.join(facts)}."


def format_whole_id(of: UnattributedDriveFit) -> str:
    """Returns the id by which a drive that was fitted as a whole is adopted."""
    return f"{of.channel} as a whole"


def describe_whole(of: UnattributedDriveFit) -> str:
    """Returns a drive that was fitted as a whole: its effects, and the 90 % intervals."""
    sizes = ", ".join(f"{find_effect_title(name)} {format_size(size)}" for name, size in of.sizes)
    return _("{channel} as a whole: {sizes}").format(channel=name_channel(of.channel), sizes=sizes)


def describe_gain(gain: Gain) -> str:
    """Returns the change of an error with its 90 % interval, %; no gain where this holds 0."""
    if gain.before <= 0.0:
        return "no error before"
    less, low, high = (
        100.0 * (1.0 - value / gain.before) for value in (gain.after, gain.high, gain.low)
    )
    if low <= 0.0 <= high:
        return f"no gain shown (90 %: {low:.0f} to {high:.0f} % less)"
    word = "less" if less > 0.0 else "more"
    near, far = sorted((abs(low), abs(high)))
    return f"{abs(less):.0f} % {word} (90 %: {near:.0f} to {far:.0f} %)"


def describe_whole_gain(of: UnattributedDriveFit) -> str:
    """Returns the gain of a drive that was fitted as a whole."""
    return _(
        "Which of these is wrong is not told apart. Adopted together they predict rows that "
        "were not fitted to: "
        "error {before} -> {after} {unit}."
    ).format(
        before=use_plain_minus(format_number(of.before)),
        after=use_plain_minus(format_number(of.after)),
        unit=_(of.unit),
    )


def sort_adoptable(found: Diagnosis) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Returns the ids of effects and terms that a machine file may adopt, and a line for each that
    it may not."""
    kept, refused = ([] if found.fitted is None else [format_whole_id(found.fitted)]), []
    for cause in found.causes:
        if is_in_drive_fit(found, cause):
            # The part of this effect that is certain is already in the fit of the whole drive.
            continue
        if cause.scope is not None:
            refused.append(f"{cause.id}: holds in the rows of {cause.scope} only")
        elif why := find_cause_refusal(cause):
            refused.append(f"{cause.id}: {why}")
        else:
            kept.append(cause.id)
    # A term may model a residual structure; such a structure is then not listed as refused.
    modelled = {(term.stage, one["name"]) for term in found.terms for one in term.term["over"]}
    for term in found.terms:
        if why := find_term_refusal(term):
            refused.append(f"{term.term['id']}: {why}")
        else:
            kept.append(term.term["id"])
    refused += [
        f"{left.channel} over {left.variable or 'nothing recorded'}: no effect explains it: "
        "nothing to model"
        for left in found.unexplained
        if (left.channel, left.variable) not in modelled
    ]
    return tuple(kept), tuple(refused)


class UndetectedEffects(NamedTuple):
    """Lists effects that were not found.

    `seen` has the smallest size at which each would have been found, `blind` the effects that these
    data cannot show although data of their kind might, `elsewhere` the effects that need other
    data.
    """

    seen: tuple[UnnamedEffect, ...]
    blind: tuple[str, ...]
    elsewhere: tuple[str, ...]


def list_undetected_effects(found: Diagnosis) -> UndetectedEffects:
    """Returns the effects that were not found. Several kinds of data are joined by a plus."""
    # Effects without a smallest detectable size are those that no size makes visible in these data.
    blind = [one.id for one in found.not_shown if one.smallest_detectable.value is None]
    hoped_for = [
        one
        for one in blind
        if one in CATALOGUE
        and any(
            kind in where
            # A diagnosis of two kinds of tables joins their names by a plus, e.g. "catch+lag".
            for kind in found.data.kind.split("+")
            for where in CATALOGUE[one].effect.seen_in
        )
    ]
    return UndetectedEffects(
        tuple(one for one in found.not_shown if one.smallest_detectable.value is not None),
        tuple(hoped_for),
        tuple(one for one in blind if one not in hoped_for),
    )


def list_not_judged(found: Diagnosis) -> tuple[str, ...]:
    """Returns channels that a run log of this machine may have and that could not be judged in this
    log; none for bench tables."""
    # A bench table has only the channels of its test, so no channel is missing there.
    may, judged = found.data.stages or RUN_CHANNELS, {channel.channel for channel in found.channels}
    return (
        tuple(channel for channel in RUN_CHANNELS if channel in may and channel not in judged)
        if found.data.kind == "run"
        else ()
    )


def format_verdict_line(found: Diagnosis) -> str:
    """Returns the channels that were not judged, then the verdict, in one line; for tied rivals
    also the test that separates them."""
    # A test that separates tied rivals is worth more to the operator than their names.
    if (
        found.verdict == "ambiguous"
        and found.next_run is not None
        and any(map(has_named_rivals, found.causes))
    ):
        return _describe_next_test(found)
    missing = list_not_judged(found)
    # The verdict "not judged" already lists the reason, so the channels need no sentence before it.
    if not missing or found.verdict == "not_judged":
        return _format_verdict(found)
    channels = ", ".join(map(name_channel, missing))
    return f"{_('Not judged: {channels}.').format(channels=channels)} {_format_verdict(found)}"


def _describe_next_test(found: Diagnosis) -> str:
    """Returns the headline while several causes are possible: the next test. If no planned test
    separates them, the headline names them and says that the data cannot decide."""
    assert found.next_run is not None
    # A step without a duration, e.g. an inspection, has no minutes.
    minutes = f" ({found.next_run.minutes:g} min)" if found.next_run.minutes else ""
    equals, what = (
        # dict.fromkeys removes doubles and keeps the order of the probabilities.
        dict.fromkeys(name for cause in found.causes for name, _sure in list_ties(cause)),
        list_next_steps(found)[0],
    )
    said = (
        [
            _("Test next: {what}{minutes}.").format(what=what, minutes=minutes),
            _("It tells apart: {causes}.").format(causes="; ".join(equals)),
        ]
        if found.next_run.id
        else [
            _("Either {causes}: nothing in this data tells which. Next: {what}.").format(
                causes=_(", or: ").join(equals), what=what
            )
        ]
    )
    sure = [
        find_cause_title(cause)
        for cause in found.causes
        if not has_named_rivals(cause) and is_headline(cause)
    ]
    if sure:
        said.append(_("Sure: {causes}.").format(causes="; ".join(sure)))
    return " ".join(said)


def _format_verdict(found: Diagnosis) -> str:
    likely = [cause for cause in found.causes if is_headline(cause)]
    suspected = len(found.causes) - len(likely)
    if found.verdict == "none":
        return _("Everything is as the machine file says, as far as the sensors can tell.")
    if found.verdict == "not_judged":
        return (
            _("This data is too short, or moves too little, to say that nothing is wrong.")
            if found.channels
            else _("None of this data could be compared with the machine file.")
        )
    if found.verdict == "unexplained" and found.unexplained:
        said = describe_unexplained(found.unexplained[0], found.data.kind, column=False)
        # A known cause next to an unexplained part is named too: the operator can act on it at
        # once.
        return said if not likely else f"{said} {_('Besides:')} {find_cause_title(likely[0])}."
    if not found.causes:
        return _("Nothing with a name was found.")
    if not likely:
        return _(
            "Something is there, but no cause is likely enough to be named; suspected: {count}."
        ).format(count=suspected)
    said = (
        "   ".join(
            f"{number}. {_describe_doubtful(cause)}" for number, cause in enumerate(likely, 1)
        )
        if (len(likely) > 1)
        else _describe_doubtful(likely[0])
    )
    return (
        f"{said}   {_('Only suspected: {count}.').format(count=suspected)}" if suspected else said
    )


def _describe_doubtful(cause: Cause) -> str:
    """Returns one cause, and the number of other causes that are possible instead."""
    first, rivals = (
        find_cause_title(cause),
        [find_effect_title(one) for one, _share in list_rivals(cause)],
    )
    if not rivals:
        return _("{first}.").format(first=first)
    if len(rivals) == 1:
        return _("{first}, or: {other}. This data cannot tell.").format(
            first=first, other=rivals[0]
        )
    return _("{first}, or one of {count} others: this data cannot tell.").format(
        first=first, count=len(rivals)
    )


def list_next_steps(found: Diagnosis) -> tuple[str, ...]:
    """Returns the next steps of a person as items of a list, each with a capital and without a full
    stop."""
    steps = (_(step) for step in found.next_run.to_do()) if found.next_run is not None else ()
    # The first letter alone is raised: str.capitalize() would lower names such as GNSS.
    return tuple(step[0].upper() + step[1:].rstrip(".") for step in steps if step)


def describe_improvement(
    old: float, new: float, low: float | None, high: float | None, lead: str = ""
) -> str:
    """Returns whether a new machine file predicts a channel better, by the r.m.s. errors of both
    and the 90 % interval of old minus new.

    The interval is None for a log that is too short. `lead` is the text before the word.
    """
    if low is None or high is None:
        return _("the log is too short to say")
    # An interval with zero inside means that the difference may be chance.
    if low <= 0.0 <= high:
        return _("no difference beyond chance")
    # A perfect old prediction has no percentage.
    share = f"{100.0 * abs(1.0 - new / old):.0f}" if old > 0.0 else "-"
    form = _("better: {percent} % less error") if low > 0.0 else _("worse: {percent} % more error")
    return lead + form.format(percent=share)

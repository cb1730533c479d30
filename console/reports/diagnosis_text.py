"""How is a diagnosis summarised in words? The summary has cause, probability, cost and next step,
and is read in ten seconds.
"""

from __future__ import annotations

from collections.abc import Sequence

from topdress.console.reports import diagnosis_wording
from topdress.console.reports.number_text import format_p_value
from topdress.console.reports.term_words import describe_compensation, describe_term
from topdress.control.diagnosis.result import Cause, Diagnosis
from topdress.control.diagnosis.runs.rates import describe_rate_value
from topdress.control.diagnosis.runs.several import JointDiagnosis
from topdress.control.machine.machine import CATALOGUE

# More limits fill the terminal; --json lists all.
MAX_SHOWN_LIMITS = 8


def summarise_terminal(found: Diagnosis) -> list[str]:
    """Returns lines for a terminal."""
    # Headlines come before suspected causes.
    found = diagnosis_wording.sort_headlines(found)
    lines = [_describe_data(found)]
    missing = diagnosis_wording.list_not_judged(found)
    if missing:
        lines.append(f"not judged: {', '.join(missing)}")
    lines += [f"note: {sentence}" for sentence in found.findings]
    if found.channels:
        # A blank line separates the notes from the table.
        lines.append("")
        lines.append(
            f"{'channel':8s} {'rows':>9s} {'bias':>10s} {'rmse':>10s} {'noise':>10s}  p(structure)"
        )
        lines += [
            f"{c.channel:8s} {c.n:9d} {c.bias:10.4g} {c.rmse:10.4g} {c.noise_floor:10.4g}  "
            f"{format_p_value(c.structure_p)} ({c.unit})"
            for c in found.channels
        ]
    # A single pass repeats the total, so the table is omitted.
    if len(found.rates) > 1:
        lines += [
            "",
            f"{'pass':>4s} {'from s':>9s} {'to s':>9s} {'rows':>6s}  applied against target",
        ]
        lines += [
            f"{fit.number:4d} {fit.begin_s:9.1f} {fit.end_s:9.1f} {fit.rows:6d}  "
            f"{describe_rate_value(fit)}"
            for fit in found.rates
            if fit.number is not None
        ]
    # Causes precede the unexplained parts: they are what a person acts on.
    for cause in found.causes:
        lines += ["", *_describe_cause(cause)]
    for line in _describe_unexplained(found):
        lines += ["", line]
    for term in found.terms:
        lines += [
            "",
            f"term {term.term['id']}: {describe_term(term.term)}",
            f"    {describe_compensation(term.term)}",
        ]
        # A term can predict well without a physical cause, which the line must state.
        lines += ["    predicts best; no cause is named by it"] if term.predicts_best else []
    lines += (
        []
        if found.fitted is None
        else [
            diagnosis_wording.describe_whole(found.fitted),
            f"    {diagnosis_wording.describe_whole_gain(found.fitted)}",
        ]
    )
    for gain in found.gain:
        lines.append(
            f"gain where no size was fitted ({gain.held_out}): {gain.channel} {gain.metric} "
            f"{gain.before:.4g} -> {gain.after:.4g}: {diagnosis_wording.describe_gain(gain)}"
        )
    if found.next_run is not None:
        lines += ["", f"next run: {found.next_run.plan}", f"    because {found.next_run.why}"]
    lines += ["", *_describe_not_shown(found)]
    if found.extended_machine:
        lines.append(f"extended machine: {found.extended_machine}")
    return lines


def describe_adoption(found: Diagnosis) -> list[str]:
    """Returns the effects of a run's diagnosis that a machine file adopts, and those that it does
    not adopt, with reasons."""
    kept, left = diagnosis_wording.sort_adoptable(found) if found.data.kind == "run" else ((), ())
    return ([f"a machine file takes up: {', '.join(kept)}"] if kept else []) + [
        f"it leaves {one}" for one in left
    ]


def describe_common(found: JointDiagnosis) -> list[str]:
    """Returns the effects that logs of machines of a kind share, each with its own size."""
    paths = [one.data.path for one in found.each]
    lines = [
        f"{' + '.join(paths)} on {found.machine.id}: not one machine, but machines of a "
        "kind: the same is wrong "
        "in each log, by a size of its own"
    ]
    for one in found.of_a_kind:
        lines += [
            "",
            f"{one.id}: {CATALOGUE[one.id].effect.title}",
            f"    chance of sizes so far apart in one machine: {one.p:.2g}",
            *(
                f"    {path}: {diagnosis_wording.format_size(size)}"
                for path, size in zip(paths, one.sizes, strict=True)
            ),
        ]
    return lines


def describe_by_log(
    each: Sequence[Diagnosis], beyond: str = ", beyond what they share"
) -> list[str]:
    """Returns the findings of each single log: one line each, and its details."""
    lines = ["", f"each log by itself{beyond}:"]
    for found in each:
        # The first two lines hold name and size; the advice is the same in each log.
        own = [line for cause in found.causes for line in _describe_cause(cause)[:2]]
        own += _describe_unexplained(found)
        own += [f"term {one.term['id']}: {describe_term(one.term)}" for one in found.terms]
        lines += [
            f"  {found.data.path}: {_describe_verdict(found)}",
            *(f"    {line}" for line in own),
        ]
    return lines


def _describe_data(found: Diagnosis) -> str:
    data = found.data
    span = "" if data.duration_s is None else f", {data.duration_s:.0f} s"
    of = f"{data.path or 'data'} ({data.kind}, {data.rows} rows{span})"
    return f"{of} on {data.machine}: {_describe_verdict(found)}"


def _describe_verdict(found: Diagnosis) -> str:
    word = diagnosis_wording.VERDICT_WORDS[found.verdict][0]
    if found.verdict != "not_judged":
        return word
    if found.channels:
        return f"{word}: too short, or too little moved, to say that nothing is wrong"
    return f"{word}: no channel of this data could be held against the model" + (
        # Dose and target can be compared even where no channel has a model.
        "; applied against target was" if found.rates else ""
    )


def _describe_unexplained(found: Diagnosis) -> list[str]:
    return [
        f"unexplained: {diagnosis_wording.describe_unexplained(one, found.data.kind)}"
        for one in found.unexplained
    ]


def _describe_cause(cause: Cause) -> list[str]:
    entry = CATALOGUE.get(cause.id)
    which = "" if cause.member is None else f", number {cause.member}"
    then = diagnosis_wording.describe_time_span(cause)
    suspected = "" if diagnosis_wording.is_headline(cause) else "suspected: "
    lines = [
        f"{suspected}{cause.id}: {entry.effect.title if entry else ''}",
        f"    {diagnosis_wording.format_size(cause.size)}{which}{then and f', {then}'}; "
        f"probability "
        f"{cause.probability:.2f}",
    ]
    rivals = [
        f"{diagnosis_wording.find_effect_name(rival)} ({share:.2f})"
        for rival, share in diagnosis_wording.list_rivals(cause)
    ]
    if rivals:
        lines.append(f"    could also be: {', '.join(rivals)}")
    # The advice of a tied cause holds only if it is the right one.
    which = ", if it is this" if diagnosis_wording.has_named_rivals(cause) else ""
    return [
        *lines,
        f"    in the field{which}: {diagnosis_wording.describe_field_cost(cause.field_cost)}",
        f"    do: {cause.advice}",
    ]


def _describe_not_shown(found: Diagnosis) -> list[str]:
    # Effects that need other data are left to the report, because the terminal's summary is short.
    seen, blind, _elsewhere = diagnosis_wording.list_undetected_effects(found)
    lines = []
    if seen:
        detectable = [
            f"{one.id} {abs(one.smallest_detectable.value or 0.0):.2g} "
            f"{one.smallest_detectable.unit}"
            for one in seen[:MAX_SHOWN_LIMITS]
        ]
        more = (
            f" and {len(seen) - MAX_SHOWN_LIMITS} more (--json)"
            if len(seen) > MAX_SHOWN_LIMITS
            else ""
        )
        lines.append(f"would have been seen from: {'; '.join(detectable)}{more}")
    if blind:
        lines.append(f"cannot be seen in this data: {', '.join(blind)}")
    return lines

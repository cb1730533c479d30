"""A diagnosis in words: what, how sure, what it costs, what to do; read in ten seconds."""

from __future__ import annotations

from collections.abc import Sequence

from topdress.console.reports import diagnosis_wording
from topdress.console.reports.numbers import format_p_value
from topdress.console.reports.term_words import describe_compensation, sentence
from topdress.control.diagnosis.result import Cause, Diagnosis
from topdress.control.diagnosis.runs.rates import in_words
from topdress.control.diagnosis.runs.several import Several
from topdress.control.machine.machine import CATALOGUE

SHOWN_LIMIT = 8


def summary(found: Diagnosis) -> list[str]:
    """Lines for a terminal."""
    found = diagnosis_wording.headlines_first(found)
    lines = [_head(found)]
    missing = diagnosis_wording.not_judged(found)
    if missing:
        lines.append(f"not judged: {', '.join(missing)}")
    lines += [f"note: {sentence}" for sentence in found.findings]
    if found.channels:
        lines.append("")
        lines.append(
            f"{'channel':8s} {'rows':>9s} {'bias':>10s} {'rmse':>10s} {'noise':>10s}  p(structure)"
        )
        lines += [
            f"{c.channel:8s} {c.n:9d} {c.bias:10.4g} {c.rmse:10.4g} {c.noise_floor:10.4g}  "
            f"{format_p_value(c.structure_p)} ({c.unit})"
            for c in found.channels
        ]
    if len(found.rates) > 1:
        lines += [
            "",
            f"{'pass':>4s} {'from s':>9s} {'to s':>9s} {'rows':>6s}  applied against target",
        ]
        lines += [
            f"{fit.number:4d} {fit.begin_s:9.1f} {fit.end_s:9.1f} {fit.rows:6d}  {in_words(fit)}"
            for fit in found.rates
            if fit.number is not None
        ]
    for cause in found.causes:
        lines += ["", *_cause(cause)]
    for line in _left(found):
        lines += ["", line]
    for term in found.terms:
        lines += [
            "",
            f"term {term.term['id']}: {sentence(term.term)}",
            f"    {describe_compensation(term.term)}",
        ]
        lines += ["    predicts best; no cause is named by it"] if term.predicts_best else []
    lines += (
        []
        if found.fitted is None
        else [
            diagnosis_wording.whole(found.fitted),
            f"    {diagnosis_wording.describe_whole_gain(found.fitted)}",
        ]
    )
    for gain in found.gain:
        lines.append(
            f"gain on data the naming never saw ({gain.held_out}): {gain.channel} {gain.metric} "
            f"{gain.before:.4g} -> {gain.after:.4g} (90 %: {gain.low:.3g} to {gain.high:.3g})"
        )
    if found.next_run is not None:
        lines += ["", f"next run: {found.next_run.plan}", f"    because {found.next_run.why}"]
    lines += ["", *_not_shown(found)]
    if found.extended_machine:
        lines.append(f"extended machine: {found.extended_machine}")
    return lines


def describe_adoption(found: Diagnosis) -> list[str]:
    """What a machine file takes up of a run's diagnosis, and what it leaves and why."""
    kept, left = diagnosis_wording.sort_adoptable(found) if found.data.kind == "run" else ((), ())
    return ([f"a machine file takes up: {', '.join(kept)}"] if kept else []) + [
        f"it leaves {one}" for one in left
    ]


def of_a_kind(found: Several) -> list[str]:
    """What logs of machines of a kind have in common, each by its own size."""
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
                f"    {path}: {diagnosis_wording.sized(size)}"
                for path, size in zip(paths, one.sizes, strict=True)
            ),
        ]
    return lines


def describe_by_log(
    each: Sequence[Diagnosis], beyond: str = ", beyond what they share"
) -> list[str]:
    """What logs have of their own: a line each, and what is behind it."""
    lines = ["", f"each log by itself{beyond}:"]
    for found in each:
        own = [line for cause in found.causes for line in _cause(cause)[:2]]
        own += _left(found)
        own += [f"term {one.term['id']}: {sentence(one.term)}" for one in found.terms]
        lines += [f"  {found.data.path}: {_verdict(found)}", *(f"    {line}" for line in own)]
    return lines


def _head(found: Diagnosis) -> str:
    data = found.data
    span = "" if data.duration_s is None else f", {data.duration_s:.0f} s"
    of = f"{data.path or 'data'} ({data.kind}, {data.rows} rows{span})"
    return f"{of} on {data.machine}: {_verdict(found)}"


def _verdict(found: Diagnosis) -> str:
    word = diagnosis_wording.VERDICTS[found.verdict][0]
    if found.verdict != "not_judged":
        return word
    if found.channels:
        return f"{word}: too short, or too little moved, to say that nothing is wrong"
    return f"{word}: no channel of this data could be held against the model" + (
        "; applied against target was" if found.rates else ""
    )


def _left(found: Diagnosis) -> list[str]:
    return [
        f"unexplained: {diagnosis_wording.left(one, found.data.kind)}" for one in found.unexplained
    ]


def _cause(cause: Cause) -> list[str]:
    entry = CATALOGUE.get(cause.id)
    which = "" if cause.member is None else f", number {cause.member}"
    then = diagnosis_wording.when(cause)
    suspected = "" if diagnosis_wording.is_headline(cause) else "suspected: "
    lines = [
        f"{suspected}{cause.id}: {entry.effect.title if entry else ''}",
        f"    {diagnosis_wording.sized(cause.size)}{which}{then and f', {then}'}; probability "
        f"{cause.probability:.2f}",
    ]
    rivals = [
        f"{diagnosis_wording.name_of(rival)} ({share:.2f})"
        for rival, share in diagnosis_wording.others(cause)
    ]
    if rivals:
        lines.append(f"    could also be: {', '.join(rivals)}")
    which = ", if it is this" if diagnosis_wording.tied(cause) else ""
    return [
        *lines,
        f"    in the field{which}: {diagnosis_wording.cost(cause.field_cost)}",
        f"    do: {cause.advice}",
    ]


def _not_shown(found: Diagnosis) -> list[str]:
    seen, blind, _elsewhere = diagnosis_wording.list_not_seen(found)
    lines = []
    if seen:
        detectable = [
            f"{one.id} {abs(one.smallest_detectable.value or 0.0):.2g} "
            f"{one.smallest_detectable.unit}"
            for one in seen[:SHOWN_LIMIT]
        ]
        more = f" and {len(seen) - SHOWN_LIMIT} more (--json)" if len(seen) > SHOWN_LIMIT else ""
        lines.append(f"would have been seen from: {'; '.join(detectable)}{more}")
    if blind:
        lines.append(f"cannot be seen in this data: {', '.join(blind)}")
    return lines

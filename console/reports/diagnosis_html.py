"""A diagnosis as one HTML file that needs nothing else: verdict, causes with pictures, what to
do, where it is from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from topdress.console.reports import diagnosis_wording as sentences
from topdress.console.reports.html import (
    Picture,
    escape,
    facts,
    figure,
    folded,
    format_paragraph,
    items,
    page,
    section,
    table,
)
from topdress.console.reports.numbers import (
    count_decimals,
    fixed,
    format_p_value,
    number,
    percent,
    span_of,
    with_interval,
)
from topdress.console.reports.pictures import pictures_of
from topdress.console.reports.term_words import describe_compensation
from topdress.console.reports.term_words import sentence as term_sentence
from topdress.control.diagnosis.result import UNKNOWN, Cause, Diagnosis, Gain, TermFound
from topdress.control.machine.machine import CATALOGUE

# Small bars in the text: an interval about its value, and shares of one.
WIDTH, HEIGHT = 220.0, 22.0
MARGIN = 8.0


def interval_bar(value: float, low: float, high: float, said: str) -> str:
    """A line from low to high with its value, and where zero is. `said`: the same in words,
    already escaped."""
    least, most = min(0.0, low, value), max(0.0, high, value)
    wide = (most - least) or 1.0

    def at(x: float) -> float:
        return MARGIN + (x - least) / wide * (WIDTH - 2.0 * MARGIN)

    middle = HEIGHT / 2.0
    return (
        f'<svg class="bar" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}" '
        f'height="{HEIGHT:g}" role="img" '
        f'aria-label="{said}"><line class="base" x1="{at(least):.1f}" x2="{at(most):.1f}" '
        f'y1="{middle:g}" '
        f'y2="{middle:g}"/><line class="zero" x1="{at(0.0):.1f}" x2="{at(0.0):.1f}" y1="2" '
        f'y2="{HEIGHT - 2.0:g}"/>'
        f'<line class="interval" x1="{at(low):.1f}" x2="{at(high):.1f}" y1="{middle:g}" '
        f'y2="{middle:g}"/>'
        f'<circle class="value" cx="{at(value):.1f}" cy="{middle:g}" r="5"/></svg>'
    )


def share_bar(share: float, said: str, leading: bool) -> str:
    """A bar filled to a share between 0 and 1."""
    full = WIDTH - 2.0 * MARGIN
    filled = full * min(1.0, max(0.0, share))
    return (
        f'<svg class="bar" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}" '
        f'height="{HEIGHT:g}" role="img" '
        f'aria-label="{said}"><rect class="trough" x="{MARGIN:g}" y="5" width="{full:g}" '
        'height="12" rx="2"/>'
        f'<rect class="{"share" if leading else "other"}" x="{MARGIN:g}" y="5" '
        f'width="{filled:.1f}" height="12" '
        f'rx="2"/></svg>'
    )


def diagnosis_page(found: Diagnosis, tools: Mapping[str, Any]) -> str:
    """The page.

    `tools`: {"columns": the run log's columns, "machine": Machine} or {"tables": [BenchTable],
    "machine": Machine}; also, where known, "date" (text), "sha256" (path -> checksum) and
    "version" (of this program). Checksums that are not given are taken from the files where
    they can be read.
    """
    found = sentences.headlines_first(found)
    pictures = pictures_of(found, tools)
    parts = (
        _head(found),
        _next_run(found) if found.verdict == "ambiguous" else "",
        section("About the data", items(found.findings)),
        section(
            "What was found",
            *(_cause(cause, pictures.causes[k]) for k, cause in enumerate(found.causes)),
        ),
        section(
            "What no known effect explains",
            *(
                format_paragraph(sentences.left(one, found.data.kind)) + figure(picture)
                for one, picture in zip(found.unexplained, pictures.left, strict=True)
            ),
            *(
                _term(term, picture)
                for term, picture in zip(found.terms, pictures.terms, strict=False)
            ),
        ),
        section(
            "The drive as a whole",
            items(
                [f"{sentences.whole(found.fitted)}.", sentences.describe_whole_gain(found.fitted)]
            )
            if found.fitted is not None
            else "",
        ),
        section("Measured and predicted", *(figure(picture) for picture in pictures.data)),
        "" if found.verdict == "ambiguous" else _next_run(found),
        folded(
            "Figures of the method, for whoever wants to check it",
            section("Gain on data that the naming never saw", _gains(found.gain)),
            section("Channels", _channels(found)),
            _not_shown(found),
        ),
        _provenance(found, tools),
    )
    return page(
        f"Diagnosis of {found.data.path or 'data'}", "\n".join(part for part in parts if part)
    )


def _head(found: Diagnosis) -> str:
    data = found.data
    span = "" if data.duration_s is None else f", {span_of(data.duration_s)}"
    kind = "run log" if data.kind == "run" else f"{data.kind.replace('+', ' and ')} table"
    return (
        f"<header><h1>Diagnosis of {escape(data.path or 'data')}</h1>\n"
        f'<p class="verdict">{escape(sentences.sentence(found))}</p>\n'
        f'<p><span class="word">{escape(sentences.VERDICTS[found.verdict][0])}</span> '
        f'<span class="dim">{escape(kind)}, {data.rows} rows{span}, against the machine '
        f"{escape(data.machine)}</span></p></header>"
    )


def _cause(cause: Cause, pictures: Sequence[Any]) -> str:
    entry = CATALOGUE.get(cause.id)
    unit = "" if entry is not None and entry.effect.onset_only else cause.size.unit
    pairs = [("Size", _size(cause, unit))] if unit else []
    if cause.member is not None:
        where = {"canopy": "head", "flow": "outlet"}.get(cause.id.split(".")[0], "number")
        pairs.append(("Which", f"{where} {cause.member}"))
    then = sentences.when(cause)
    if then:
        pairs.append(("When", escape(then)))
    pairs += [
        ("Probability", _shares(cause)),
        ("In the field", escape(sentences.cost(cause.field_cost))),
        ("What to do", f'<span class="do">{escape(cause.advice)}</span>'),
    ]
    physics = format_paragraph(entry.effect.physics, "dim") if entry else ""
    kind = "cause open" if sentences.others(cause) else "cause"
    title = sentences.heading(cause)
    title, name = title[0].upper() + title[1:], "" if sentences.tied(cause) else _id(cause.id)
    return (
        f'<section class="{kind}"><h3>{escape(title)}{name}</h3>'
        f"{physics}{facts(pairs)}{''.join(figure(picture) for picture in pictures)}</section>"
    )


def _size(cause: Cause, unit: str) -> str:
    size = cause.size
    if size.value is None:
        return "not known"
    value, interval = with_interval(size.value, size.low, size.high)
    said = f'<span class="big">{escape(value)} {escape(unit)}</span>'
    if not interval or size.low is None or size.high is None:
        return said
    words = f"90 % interval: {interval}"
    return (
        f'<div class="sized">{said}{interval_bar(size.value, size.low, size.high, escape(words))}'
        f'<span class="dim">{escape(words)}</span></div>'
    )


def _shares(cause: Cause) -> str:
    """The cause's own probability and those of what could be in its place."""
    if not sentences.others(cause):
        said = escape(percent(cause.probability))
        return (
            '<div class="sized"><span '
            f'class="big">{said}</span>{share_bar(cause.probability, said, True)}</div>'
        )
    rows = [
        (one, share, escape(percent(share)))
        for one, share in ((cause.id, cause.probability), *sentences.others(cause))
    ]
    cells = "".join(
        f"<span>{escape(sentences.title_of(effect_id))}{_id(effect_id)}</span>"
        f'<span class="number">{said}</span>{share_bar(share, said, k == 0)}'
        for k, (effect_id, share, said) in enumerate(rows)
    )
    return (
        f'<div class="rivals">{cells}</div><span class="dim">This data cannot tell these '
        "apart.</span>"
    )


def _id(effect_id: str) -> str:
    """Of an effect of the catalogue."""
    return "" if effect_id == UNKNOWN else f' <span class="id">{escape(effect_id)}</span>'


def _term(found: TermFound, picture: Picture | None) -> str:
    """A term in words, what control does about it, and its picture."""
    said = format_paragraph(f"{term_sentence(found.term)}.") + format_paragraph(
        f"{describe_compensation(found.term)}.", "dim"
    )
    return said + figure(picture)


def _next_run(found: Diagnosis) -> str:
    if found.next_run is None:
        return ""
    return section(
        "Next run",
        format_paragraph(f"Why: {found.next_run.why}."),
        items([f"{step}." for step in sentences.to_do(found)], ordered=True),
    )


def _gains(gains: Sequence[Gain]) -> str:
    if not gains:
        return ""
    rows = []
    for gain in gains:
        after, interval = with_interval(gain.after, gain.low, gain.high)
        less = 100.0 * (1.0 - gain.after / gain.before) if gain.before > 0.0 else 0.0
        change = f"{abs(less):.0f} % {'less' if less >= 0.0 else 'more'}"
        rows.append(
            (gain.channel, gain.metric, number(gain.before), after, interval, change, gain.held_out)
        )
    return table(
        ("channel", "error", "nominal", "with the causes", "90 % interval", "change", "held out"),
        rows,
        frozenset({2, 3, 4, 5}),
    ) + format_paragraph("The interval is of the error with the causes.", "dim")


def _channels(found: Diagnosis) -> str:
    if not found.channels:
        return ""
    rows = [
        (
            c.channel,
            c.unit,
            str(c.n),
            *_alike(c.bias, c.rmse, c.noise_floor),
            fixed(100.0 * c.explained_by_nominal, 1),
            format_p_value(c.structure_p),
        )
        for c in found.channels
    ]
    return table(
        (
            "channel",
            "unit",
            "rows",
            "bias",
            "rms error",
            "noise",
            "explained by nominal, %",
            "p of structure",
        ),
        rows,
        frozenset(range(2, 8)),
    ) + format_paragraph(
        "Errors of the nominal machine. p of structure: how often noise alone would show so "
        "much; below 0.01 the model "
        "lacks something.",
        "dim",
    )


def _alike(bias: float, rmse: float, noise: float) -> tuple[str, str, str]:
    """The three to the same decimals: three digits of the noise."""
    decimals = count_decimals(noise if noise > 0.0 else rmse) + 1
    return fixed(bias, decimals), fixed(rmse, decimals), fixed(noise, decimals)


def _not_shown(found: Diagnosis) -> str:
    seen, blind, elsewhere = sentences.list_not_seen(found)
    inside = []
    if seen:
        inside += [
            format_paragraph("Not found; each would have been seen from this size on:"),
            table(
                ("effect", "what happens", "smallest size seen"),
                [
                    (
                        one.id,
                        sentences.title_of(one.id),
                        (
                            f"{number(abs(one.smallest_detectable.value or 0.0), 2)} "
                            f"{one.smallest_detectable.unit}"
                        ),
                    )
                    for one in seen
                ],
            ),
        ]
    if blind:
        inside += [
            format_paragraph(
                "Cannot be seen in this data at all, though data of this kind might show it:"
            ),
            table(("effect", "what happens"), [(one, sentences.title_of(one)) for one in blind]),
        ]
    if elsewhere:
        inside.append(
            format_paragraph(f"Other kinds of data are needed for: {', '.join(elsewhere)}.", "dim")
        )
    return section("Not shown", *inside)


def _provenance(found: Diagnosis, tools: Mapping[str, Any]) -> str:
    from topdress.drivers.files.run_meta import software_version

    pairs = []
    for path in [p for p in found.data.path.split(" + ") if p]:
        pairs.append(("Data", escape(path)))
        checksum = _checksum(path, tools.get("sha256"))
        if checksum:
            pairs.append(("sha256", f"<code>{escape(checksum)}</code>"))
    pairs += [
        ("Machine", escape(found.data.machine)),
        ("Written by", f"topdress {escape(tools.get('version') or software_version())}"),
    ]
    if tools.get("date"):
        pairs.append(("Date", escape(tools["date"])))
    if found.extended_machine:
        pairs.append(("Extended machine", escape(found.extended_machine)))
    return section("Where this is from", facts(pairs))


def _checksum(path: str, given: Mapping[str, str] | str | None) -> str:
    if isinstance(given, str):
        return given
    if given and path in given:
        return given[path]
    from topdress.drivers.files.config import sha256_of

    try:
        return sha256_of(Path(path))
    except OSError:
        return ""

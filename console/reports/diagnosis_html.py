"""How is a diagnosis shown as one self-contained HTML file? It has verdict, causes with pictures,
next steps and the origin of the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from topdress.console.reports import diagnosis_wording as sentences
from topdress.console.reports.html import (
    Picture,
    escape_text,
    format_facts,
    format_figure,
    format_folded,
    format_list,
    format_paragraph,
    format_section,
    format_table,
    make_page,
)
from topdress.console.reports.number_text import (
    count_decimals,
    format_duration,
    format_fixed,
    format_number,
    format_p_value,
    format_percent,
    format_with_interval,
)
from topdress.console.reports.pictures import draw_pictures
from topdress.console.reports.term_words import describe_compensation
from topdress.console.reports.term_words import describe_term as term_sentence
from topdress.control.diagnosis.result import UNKNOWN, Cause, Diagnosis, Gain, TermFound
from topdress.control.machine.machine import CATALOGUE

# Size of the small bars in the text, for an interval about its value and for shares, points.
BAR_WIDTH, BAR_HEIGHT = 220.0, 22.0
# The margin keeps the round marker at either end inside the picture, points.
BAR_MARGIN = 8.0


def draw_interval_bar(value: float, low: float, high: float, said: str) -> str:
    """Returns a line from low to high with its value, and the position of zero. `said` is the same
    in words, already escaped."""
    # Zero is always inside of the bar, since the distance from zero is what the reader judges.
    least, most = min(0.0, low, value), max(0.0, high, value)
    # A bar of no length would divide by zero.
    wide = (most - least) or 1.0

    def place_value(x: float) -> float:
        return BAR_MARGIN + (x - least) / wide * (BAR_WIDTH - 2.0 * BAR_MARGIN)

    middle = BAR_HEIGHT / 2.0
    return (
        f'<svg class="bar" viewBox="0 0 {BAR_WIDTH:g} {BAR_HEIGHT:g}" width="{BAR_WIDTH:g}" '
        f'height="{BAR_HEIGHT:g}" role="img" '
        # Screen readers read the label instead of the drawing.
        f'aria-label="{said}"><line class="base" x1="{place_value(least):.1f}" x2="'
        f'{place_value(most):.1f}" '
        f'y1="{middle:g}" '
        f'y2="{middle:g}"/><line class="zero" x1="{place_value(0.0):.1f}" x2="'
        f'{place_value(0.0):.1f}" y1="2" '
        f'y2="{BAR_HEIGHT - 2.0:g}"/>'
        f'<line class="interval" x1="{place_value(low):.1f}" x2="{place_value(high):.1f}" y1="'
        f'{middle:g}" '
        f'y2="{middle:g}"/>'
        f'<circle class="value" cx="{place_value(value):.1f}" cy="{middle:g}" r="5"/></svg>'
    )


def draw_share_bar(share: float, said: str, leading: bool) -> str:
    """Returns a bar filled to a share between 0 and 1."""
    full = BAR_WIDTH - 2.0 * BAR_MARGIN
    # Rounding can push a probability slightly beyond 0 or 1.
    filled = full * min(1.0, max(0.0, share))
    return (
        f'<svg class="bar" viewBox="0 0 {BAR_WIDTH:g} {BAR_HEIGHT:g}" width="{BAR_WIDTH:g}" '
        f'height="{BAR_HEIGHT:g}" role="img" '
        f'aria-label="{said}"><rect class="trough" x="{BAR_MARGIN:g}" y="5" width="{full:g}" '
        'height="12" rx="2"/>'
        f'<rect class="{"share" if leading else "other"}" x="{BAR_MARGIN:g}" y="5" '
        f'width="{filled:.1f}" height="12" '
        f'rx="2"/></svg>'
    )


def make_diagnosis_page(found: Diagnosis, tools: Mapping[str, Any]) -> str:
    """Returns the page as HTML.

    `tools` is {"columns": the run log's columns, "machine": Machine} or {"tables": [BenchTable],
    "machine": Machine}. Optional keys are "date" (text), "sha256" (path -> checksum) and "version"
    (of this program). Missing checksums are computed from readable files.
    """
    # Pictures are drawn after sorting: each picture is matched to its cause by position.
    found = sentences.sort_headlines(found)
    pictures = draw_pictures(found, tools)
    parts = (
        _format_header(found),
        # An undecided diagnosis shows the next test first, as the terminal does.
        _format_next_run(found) if found.verdict == "ambiguous" else "",
        format_section("About the data", format_list(found.findings)),
        format_section(
            "What was found",
            *(_format_cause(cause, pictures.causes[k]) for k, cause in enumerate(found.causes)),
        ),
        format_section(
            "What no known effect explains",
            *(
                format_paragraph(sentences.describe_unexplained(one, found.data.kind))
                + format_figure(picture)
                for one, picture in zip(found.unexplained, pictures.left, strict=True)
            ),
            *(
                _format_term(term, picture)
                # A term may have no picture, so the shorter list decides.
                for term, picture in zip(found.terms, pictures.terms, strict=False)
            ),
        ),
        format_section(
            "The drive as a whole",
            format_list(
                [
                    f"{sentences.describe_whole(found.fitted)}.",
                    sentences.describe_whole_gain(found.fitted),
                ]
            )
            if found.fitted is not None
            else "",
        ),
        format_section(
            "Measured and predicted", *(format_figure(picture) for picture in pictures.data)
        ),
        # A decided diagnosis has its next run after the findings.
        "" if found.verdict == "ambiguous" else _format_next_run(found),
        format_folded(
            "Figures of the method, for whoever wants to check it",
            format_section("Gain where no size was fitted", _format_gains(found.gain)),
            format_section("Channels", _format_channels(found)),
            _format_not_shown(found),
        ),
        _format_provenance(found, tools),
    )
    return make_page(
        # Empty sections return an empty text and are omitted with their headings.
        f"Diagnosis of {found.data.path or 'data'}",
        "\n".join(part for part in parts if part),
    )


def _format_header(found: Diagnosis) -> str:
    data = found.data
    span = "" if data.duration_s is None else f", {format_duration(data.duration_s)}"
    # The kinds of bench tables are joined by a plus in the JSON result.
    kind = "run log" if data.kind == "run" else f"{data.kind.replace('+', ' and ')} table"
    return (
        f"<header><h1>Diagnosis of {escape_text(data.path or 'data')}</h1>\n"
        f'<p class="verdict">{escape_text(sentences.format_verdict_line(found))}</p>\n'
        f'<p><span class="word">{escape_text(sentences.VERDICT_WORDS[found.verdict][0])}</span> '
        f'<span class="dim">{escape_text(kind)}, {data.rows} rows{span}, against the machine '
        f"{escape_text(data.machine)}</span></p></header>"
    )


def _format_cause(cause: Cause, pictures: Sequence[Any]) -> str:
    entry = CATALOGUE.get(cause.id)
    # An effect that is only an event, e.g. a blockage, has a beginning and no size.
    unit = "" if entry is not None and entry.effect.onset_only else cause.size.unit
    pairs = [("Size", _format_size(cause, unit))] if unit else []
    if cause.member is not None:
        # Members count heads of the canopy sensor and outlets of the flow; other effects have a
        # plain number.
        where = {"canopy": "head", "flow": "outlet"}.get(cause.id.split(".")[0], "number")
        pairs.append(("Which", f"{where} {cause.member}"))
    then = sentences.describe_time_span(cause)
    if then:
        pairs.append(("When", escape_text(then)))
    pairs += [
        ("Probability", _format_rival_probs(cause)),
        ("In the field", escape_text(sentences.describe_field_cost(cause.field_cost))),
        ("What to do", f'<span class="do">{escape_text(cause.advice)}</span>'),
    ]
    physics = format_paragraph(entry.effect.physics, "dim") if entry else ""
    kind = "cause open" if sentences.list_rivals(cause) else "cause"
    title = sentences.format_heading(cause)
    # Only the first letter is raised, because capitalize() would lower GNSS and NDVI.
    title, name = (
        title[0].upper() + title[1:],
        "" if sentences.has_named_rivals(cause) else _format_effect_id(cause.id),
    )
    return (
        f'<section class="{kind}"><h3>{escape_text(title)}{name}</h3>'
        f"{physics}{format_facts(pairs)}{''.join(format_figure(picture) for picture in pictures)}"
        f"</section>"
    )


def _format_size(cause: Cause, unit: str) -> str:
    size = cause.size
    if size.value is None:
        return "not known"
    value, interval = format_with_interval(size.value, size.low, size.high)
    said = f'<span class="big">{escape_text(value)} {escape_text(unit)}</span>'
    # Some sizes have no interval, e.g. those that the data fix from one side only.
    if not interval or size.low is None or size.high is None:
        return said
    words = f"90 % interval: {interval}"
    return (
        f'<div class="sized">{said}'
        f"{draw_interval_bar(size.value, size.low, size.high, escape_text(words))}"
        f'<span class="dim">{escape_text(words)}</span></div>'
    )


def _format_rival_probs(cause: Cause) -> str:
    """Returns the cause's own probability and those of its rivals."""
    if not sentences.list_rivals(cause):
        said = escape_text(format_percent(cause.probability))
        return (
            '<div class="sized"><span '
            f'class="big">{said}</span>{draw_share_bar(cause.probability, said, True)}</div>'
        )
    rows = [
        (one, share, escape_text(format_percent(share)))
        for one, share in ((cause.id, cause.probability), *sentences.list_rivals(cause))
    ]
    cells = "".join(
        f"<span>{escape_text(sentences.find_effect_title(effect_id))}{_format_effect_id(effect_id)}</span>"
        # The first row is the cause itself and has the leading colour.
        f'<span class="number">{said}</span>{draw_share_bar(share, said, k == 0)}'
        for k, (effect_id, share, said) in enumerate(rows)
    )
    return (
        f'<div class="rivals">{cells}</div><span class="dim">This data cannot tell these '
        "apart.</span>"
    )


def _format_effect_id(effect_id: str) -> str:
    """Returns the id of an effect of the catalogue as HTML."""
    return "" if effect_id == UNKNOWN else f' <span class="id">{escape_text(effect_id)}</span>'


def _format_term(found: TermFound, picture: Picture | None) -> str:
    """Returns a term in words, its compensation by the control loop, and its picture."""
    said = format_paragraph(f"{term_sentence(found.term)}.") + format_paragraph(
        f"{describe_compensation(found.term)}.", "dim"
    )
    return said + format_figure(picture)


def _format_next_run(found: Diagnosis) -> str:
    if found.next_run is None:
        return ""
    return format_section(
        "Next run",
        format_paragraph(f"Why: {found.next_run.why}."),
        format_list([f"{step}." for step in sentences.list_next_steps(found)], ordered=True),
    )


def _format_gains(gains: Sequence[Gain]) -> str:
    if not gains:
        return ""
    rows = []
    for gain in gains:
        after, interval = format_with_interval(gain.after, gain.low, gain.high)
        rows.append(
            (
                gain.channel,
                gain.metric,
                format_number(gain.before),
                after,
                interval,
                sentences.describe_gain(gain),
                gain.held_out,
            )
        )
    return format_table(
        ("channel", "error", "nominal", "with the causes", "90 % interval", "change", "held out"),
        rows,
        # The columns with numbers are aligned right.
        frozenset({2, 3, 4, 5}),
    ) + format_paragraph(
        "Sizes were fitted to the other blocks; the causes were chosen on all blocks. The interval "
        "is that of the error with the causes, the interval of the change that of the gain.",
        "dim",
    )


def _format_channels(found: Diagnosis) -> str:
    if not found.channels:
        return ""
    rows = [
        (
            c.channel,
            c.unit,
            str(c.n),
            *_format_alike(c.bias, c.rmse, c.noise_floor),
            format_fixed(100.0 * c.explained_by_nominal, 1),
            format_p_value(c.structure_p),
        )
        for c in found.channels
    ]
    return format_table(
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


def _format_alike(bias: float, rmse: float, noise: float) -> tuple[str, str, str]:
    """Returns bias, error and noise with the same number of decimals, which shows three digits of
    the noise."""
    # A noise of zero, e.g. in simulated data, gives no scale; the error replaces it.
    decimals = count_decimals(noise if noise > 0.0 else rmse) + 1
    return format_fixed(bias, decimals), format_fixed(rmse, decimals), format_fixed(noise, decimals)


def _format_not_shown(found: Diagnosis) -> str:
    seen, blind, elsewhere = sentences.list_undetected_effects(found)
    inside = []
    if seen:
        inside += [
            format_paragraph("Not found; each would have been seen from this size on:"),
            format_table(
                ("effect", "what happens", "smallest size seen"),
                [
                    (
                        one.id,
                        sentences.find_effect_title(one.id),
                        (
                            f"{format_number(abs(one.smallest_detectable.value or 0.0), 2)} "
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
            format_table(
                ("effect", "what happens"),
                [(one, sentences.find_effect_title(one)) for one in blind],
            ),
        ]
    if elsewhere:
        inside.append(
            format_paragraph(f"Other kinds of data are needed for: {', '.join(elsewhere)}.", "dim")
        )
    return format_section("Not shown", *inside)


def _format_provenance(found: Diagnosis, tools: Mapping[str, Any]) -> str:
    from topdress.drivers.files.run_meta import find_software_version

    pairs = []
    # Several logs are joined by " + " in the result; each has its own checksum.
    for path in [p for p in found.data.path.split(" + ") if p]:
        pairs.append(("Data", escape_text(path)))
        checksum = _find_checksum(path, tools.get("sha256"))
        if checksum:
            pairs.append(("sha256", f"<code>{escape_text(checksum)}</code>"))
    pairs += [
        ("Machine", escape_text(found.data.machine)),
        ("Written by", f"topdress {escape_text(tools.get('version') or find_software_version())}"),
    ]
    if tools.get("date"):
        pairs.append(("Date", escape_text(tools["date"])))
    if found.extended_machine:
        pairs.append(("Extended machine", escape_text(found.extended_machine)))
    return format_section("Where this is from", format_facts(pairs))


def _find_checksum(path: str, given: Mapping[str, str] | str | None) -> str:
    # A checksum that the caller knows is used, since a large log takes seconds to hash.
    if isinstance(given, str):
        return given
    if given and path in given:
        return given[path]
    from topdress.drivers.files.config import calc_sha256

    try:
        return calc_sha256(Path(path))
    # The data may have been moved since the diagnosis; the page then omits the checksum.
    except OSError:
        return ""

"""How is a diagnosis shown in a notebook? The text below a cell and its pictures need neither
server nor files.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from topdress.console.reports.chart import ChartSheet
from topdress.console.reports.compare_page import describe_better, draw_comparison
from topdress.console.reports.diagnosis_text import describe_adoption, summarise_terminal
from topdress.console.reports.diagnosis_wording import (
    VERDICT_WORDS,
    describe_unexplained,
    find_effect_title,
    format_size,
    format_verdict_line,
    sort_headlines,
)
from topdress.console.reports.diagnosis_wording import describe_time_span as when_of
from topdress.console.reports.html import (
    PAGE_STYLE,
    Picture,
    escape_text,
    format_figure,
    format_table,
)
from topdress.console.reports.number_text import format_number, format_with_interval
from topdress.console.reports.term_words import describe_term as term_sentence
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.runs.compared import Compared
from topdress.control.machine.machine import Machine

# The page's colours are limited to this class, so that they do not restyle the notebook around the
# cell.
SCOPED_STYLE = PAGE_STYLE[: PAGE_STYLE.index("* { box-sizing")].replace(":root", ".topdress")


class Pictures:
    """Holds the pictures of a diagnosis: shown below a notebook's cell, stored by `save`.

    `pictures[k]` is the k-th as a `ChartSheet`, whose panels may be changed before it is shown.
    """

    def __init__(self, pictures: tuple[Picture, ...]) -> None:
        self._pictures = pictures

    def __len__(self) -> int:
        return len(self._pictures)

    def __getitem__(self, place: int) -> ChartSheet:
        sheet = self._pictures[place].sheet
        assert sheet is not None, "every picture of a diagnosis is a chart"
        return sheet

    @property
    def svgs(self) -> tuple[str, ...]:
        """Returns each picture as SVG."""
        return tuple(one.svg for one in self._list_redrawn())

    # A notebook user may change panels after the diagnosis; a stored SVG would be old.
    def _list_redrawn(self) -> list[Picture]:
        """Returns the pictures, drawn again, because their charts may have been changed."""
        return [
            one if one.sheet is None else one._replace(svg=one.sheet.to_svg(one.caption))
            for one in self._pictures
        ]

    def _repr_html_(self) -> str:
        return wrap_html("".join(format_figure(one) for one in self._list_redrawn()))

    def save(self, path: str | Path) -> Path:
        """Writes the pictures as a page to `path` (.html). Raises OSError."""
        from topdress.console.reports.html import make_page
        from topdress.drivers.files.atomic_files import write_atomically

        place = Path(path)
        write_atomically(place, make_page("Pictures of a diagnosis", self._repr_html_()))
        return place


# Number of lines of a printed diagnosis; the last of them counts the omitted ones.
MAX_SUMMARY_LINES = 15


def summarise_diagnosis(found: Diagnosis) -> str:
    """Returns verdict, notes, causes, terms, unexplained parts, rival and gain, one line each;
    lines beyond 15 are counted."""
    # Suspected causes come last, as on every other view of a diagnosis.
    ordered = sort_headlines(found)
    # Three notes at most leave room for causes among the lines.
    lines = [summarise_terminal(ordered)[0], *(f"note: {one}" for one in found.findings[:3])]
    for cause in ordered.causes:
        when = f", {then}" if (then := when_of(cause)) else ""
        lines.append(
            f"{cause.id}: {format_size(cause.size)}{when}, probability {cause.probability:.2f}: "
            f"{cause.advice}"
        )
    lines += [f"term {one.term['id']}: {term_sentence(one.term)}" for one in found.terms]
    lines += [
        f"unexplained: {describe_unexplained(one, found.data.kind)}" for one in found.unexplained
    ]
    for one in found.predicted:
        rival = "" if one.rival is None else f", least squares {format_number(one.rival)}"
        lines.append(
            f"error of {one.channel}: {format_number(one.before)} -> {format_number(one.file)} "
            f"{one.unit} "
            f"with what the file takes up{rival}"
        )
    lines += [
        f"gain on blocks that no size was fitted to: {one.channel} {one.metric} "
        f"{format_number(one.before)} -> {format_number(one.after)} (90 %: "
        f"{format_number(one.low)} to "
        f"{format_number(one.high)})"
        for one in found.gain
        # Only the gain of the named causes is summarised; the table has the others.
        if one.of == "names"
    ]
    if found.next_run is not None:
        lines.append(f"next run: {found.next_run.plan}")
    # The last line counts the omitted lines, so that a summary never looks complete when it is cut.
    if len(lines) > MAX_SUMMARY_LINES:
        over = len(lines) - MAX_SUMMARY_LINES + 1
        lines = [*lines[: MAX_SUMMARY_LINES - 1], f"and {over} lines more: found.to_json()"]
    return "\n".join(lines)


def make_causes_frame(found: Diagnosis) -> Any:
    """Returns the causes as a data frame with one row each. Raises ValueError, one line, without
    its library."""
    causes = found.causes
    return _make_data_frame(
        found,
        {
            "id": [one.id for one in causes],
            "size": [one.size.value for one in causes],
            "low": [one.size.low for one in causes],
            "high": [one.size.high for one in causes],
            "unit": [one.size.unit for one in causes],
            "probability": [one.probability for one in causes],
            "onset_s": [one.onset_s for one in causes],
            "rate_percent": [one.field_cost.rate_error_percent for one in causes],
            "advice": [one.advice for one in causes],
        },
    )


def summarise_compared(compared: Compared) -> str:
    """Returns a line for each note and each channel."""
    lines = [f"note: {one}" for one in compared.findings]
    lines += [
        f"{one.channel}: error {format_number(one.old)} -> {format_number(one.new)} {one.unit}, "
        f"less by "
        f"{format_number(one.low)} to {format_number(one.high)} (90 %): {describe_better(one)}"
        for one in compared.channels
    ]
    return "\n".join(lines) or "no channel of this log can be held against both machine files"


def draw_compared(compared: Compared) -> Pictures:
    """Returns pictures of an interval and of the error over time for each channel, under both
    machine files."""
    return Pictures(tuple(draw_comparison(one) for one in compared.channels))


def make_residuals_frame(found: Diagnosis) -> Any:
    """Returns measured, predicted and residual of every channel. Raises ValueError, one line."""
    from topdress.console.reports.run_views import list_effect_instances, make_run_views

    # The bins and views load only for this frame, which few notebooks request.
    from topdress.control.diagnosis.extend import extend

    columns, machine = _find_diagnosed_log(found)
    views = make_run_views(columns, machine, extend(machine, found), ())
    parts = list_effect_instances(found.causes)
    columns_out: dict[str, list[Any]] = {name: [] for name in RESIDUAL_COLUMNS}
    for view in views:
        # "Nominal" is the prediction without any cause, "predicted" the prediction with the causes
        # of this channel.
        nominal, predicted = view.predict(()), view.predict(view.select_own_parts(parts))
        columns_out["channel"] += [view.name] * len(view.measured)
        columns_out["unit"] += [view.unit] * len(view.measured)
        columns_out["time_s"] += view.time_s.tolist()
        columns_out["measured"] += view.measured.tolist()
        columns_out["nominal"] += nominal.tolist()
        columns_out["predicted"] += predicted.tolist()
        columns_out["residual"] += (view.measured - predicted).tolist()
    return _make_data_frame(found, columns_out)


# The names of the columns are a contract with notebooks that select them.
RESIDUAL_COLUMNS = ("channel", "unit", "time_s", "measured", "nominal", "predicted", "residual")


def _make_data_frame(found: Diagnosis, columns: dict[str, list[Any]]) -> Any:
    # The frame has the library of the data that were given, pandas for a log from a file.
    library = found.frame_library or "pandas"
    try:
        # The library is optional, so it is imported by name and its absence becomes one line.
        return import_module(library).DataFrame(columns)
    except ImportError:
        raise ValueError(f"a data frame needs {library}: pip install {library}") from None


def _find_diagnosed_log(found: Diagnosis) -> tuple[Any, Machine]:
    # A result that was loaded from JSON has no rows to draw.
    if found.seen_with is None:
        raise ValueError(
            "the log that this diagnosis is of is not with it: allowed is one that "
            "diagnose_run gave"
        )
    return found.seen_with


def wrap_html(inside: str) -> str:
    """Returns the HTML with the styles of a notebook's cell."""
    return f'<div class="topdress"><style>{SCOPED_STYLE}</style>{inside}</div>'


def load_named_machine(name: str) -> Machine:
    """Returns a machine file by its path, or by its name for a shipped file. Raises ValueError, one
    line."""
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_error import ConfigError
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    try:
        return load_config(name, MACHINE_KIND).model
    except ConfigError as error:
        # A notebook shows a ValueError in one line; the first line names file and key.
        raise ValueError(error.lines[0]) from None


def format_notebook_html(found: Diagnosis) -> str:
    """Returns verdict, causes and errors by channel."""
    rows = []
    # A size can be unknown, e.g. between rivals that only the next run separates.
    for cause in found.causes:
        value, interval = (
            ("not known", "")
            if cause.size.value is None
            else format_with_interval(cause.size.value, cause.size.low, cause.size.high)
        )
        rows.append(
            (
                find_effect_title(cause.id),
                cause.id,
                f"{value} {cause.size.unit}",
                interval,
                f"{100.0 * cause.probability:.0f} %",
                cause.advice,
            )
        )
    causes_html = (
        format_table(("cause", "id", "size", "90 % interval", "probability", "what to do"), rows)
        if rows
        else ""
    )
    channels = format_table(
        ("channel", "rows", "error (r.m.s.)", "noise", "unit"),
        [
            (
                one.channel,
                str(one.n),
                format_number(one.rmse),
                format_number(one.noise_floor),
                one.unit,
            )
            for one in found.channels
        ],
        # Columns of numbers are aligned right.
        frozenset({1, 2, 3}),
    )
    notes = "".join(
        f"<li>{escape_text(one)}</li>" for one in (*found.findings, *describe_adoption(found))
    )
    return wrap_html(
        f"<p><b>{escape_text(VERDICT_WORDS[found.verdict][0])}</b>: "
        f"{escape_text(format_verdict_line(found))}</p>"
        f"{causes_html}{channels}{_format_predicted(found)}"
        f"{f'<ul>{notes}</ul>' if notes else ''}"
    )


def _format_predicted(found: Diagnosis) -> str:
    """Returns the errors of each channel on the whole log: of the machine file, of the extended
    file, of the rival."""

    def format_cell(value: float | None, over: tuple[str, ...] = ()) -> str:
        return (
            ""
            if value is None
            else format_number(value) + (f" (over {', '.join(over)})" if over else "")
        )

    rows = [
        (
            one.channel,
            format_number(one.before),
            format_number(one.file),
            format_cell(one.said),
            format_cell(one.rival, one.over),
            one.unit,
        )
        for one in found.predicted
    ]
    return (
        format_table(
            (
                "error of",
                "machine file",
                "with what it takes up",
                "all that is said",
                "plain least squares",
                "unit",
            ),
            rows,
            frozenset({1, 2, 3}),
        )
        if rows
        else ""
    )


def draw_diagnosis(found: Diagnosis) -> Pictures:
    """Returns the pictures of `topdress diagnose --report`. Raises ValueError, one line, without
    the log."""
    from topdress.console.reports.pictures import draw_pictures as drawn

    columns, machine = _find_diagnosed_log(found)
    tools: dict[str, Any] = {"columns": columns, "machine": machine}
    made = drawn(found, tools)
    # The order is that of the report: causes, unexplained parts, terms, then the channels.
    every = (
        *(one for several in made.causes for one in several),
        *made.left,
        *made.terms,
        *made.data,
    )
    # A cause without a view has no picture.
    return Pictures(tuple(one for one in every if one is not None))

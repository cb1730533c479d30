"""A diagnosis in a notebook: what stands below a cell, and its pictures. Needs no server and no
files of its own."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from topdress.console.reports.chart import ChartSheet
from topdress.console.reports.compare_page import picture_of, verdict
from topdress.console.reports.diagnosis_text import describe_adoption, summary
from topdress.console.reports.diagnosis_wording import (
    VERDICTS,
    headlines_first,
    left,
    sentence,
    sized,
    title_of,
)
from topdress.console.reports.diagnosis_wording import when as when_of
from topdress.console.reports.html import STYLE, Picture, escape, figure, table
from topdress.console.reports.numbers import number, with_interval
from topdress.console.reports.term_words import sentence as term_sentence
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.runs.compared import Compared
from topdress.control.machine.machine import Machine

COLOURS = STYLE[: STYLE.index("* { box-sizing")].replace(":root", ".topdress")


class Pictures:
    """Pictures of a diagnosis: shown below a notebook's cell, kept with `save`.

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
        """Each picture by itself, as SVG."""
        return tuple(one.svg for one in self._as_styled())

    def _as_styled(self) -> list[Picture]:
        """The pictures, drawn anew: their charts may have been changed."""
        return [
            one if one.sheet is None else one._replace(svg=one.sheet.to_svg(one.caption))
            for one in self._pictures
        ]

    def _repr_html_(self) -> str:
        return framed("".join(figure(one) for one in self._as_styled()))

    def save(self, path: str | Path) -> Path:
        """As a page of its own at `path` (.html). Raises OSError."""
        from topdress.console.reports.html import page
        from topdress.drivers.files.atomic import write_atomically

        place = Path(path)
        write_atomically(place, page("Pictures of a diagnosis", self._repr_html_()))
        return place


MOST_SUMMARY_LINES = 15


def summarise(found: Diagnosis) -> str:
    """Verdict, notes, causes, terms, what is left, rival and gain, a line each; what has no room
    in 15 lines is counted."""
    ordered = headlines_first(found)
    lines = [summary(ordered)[0], *(f"note: {one}" for one in found.findings[:3])]
    for cause in ordered.causes:
        when = f", {then}" if (then := when_of(cause)) else ""
        lines.append(
            f"{cause.id}: {sized(cause.size)}{when}, probability {cause.probability:.2f}: "
            f"{cause.advice}"
        )
    lines += [f"term {one.term['id']}: {term_sentence(one.term)}" for one in found.terms]
    lines += [f"unexplained: {left(one, found.data.kind)}" for one in found.unexplained]
    for one in found.predicted:
        rival = "" if one.rival is None else f", least squares {number(one.rival)}"
        lines.append(
            f"error of {one.channel}: {number(one.before)} -> {number(one.file)} {one.unit} "
            f"with what the file takes up{rival}"
        )
    lines += [
        f"gain on blocks that no size was fitted to: {one.channel} {one.metric} "
        f"{number(one.before)} -> {number(one.after)} (90 %: {number(one.low)} to "
        f"{number(one.high)})"
        for one in found.gain
        if one.of == "names"
    ]
    if found.next_run is not None:
        lines.append(f"next run: {found.next_run.plan}")
    if len(lines) > MOST_SUMMARY_LINES:
        over = len(lines) - MOST_SUMMARY_LINES + 1
        lines = [*lines[: MOST_SUMMARY_LINES - 1], f"and {over} lines more: found.to_json()"]
    return "\n".join(lines)


def frame_causes(found: Diagnosis) -> Any:
    """The causes as a data frame, a row each. Raises ValueError, one line, without its library."""
    causes = found.causes
    return _frame(
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
    """A line for each note and each channel."""
    lines = [f"note: {one}" for one in compared.findings]
    lines += [
        f"{one.channel}: error {number(one.old)} -> {number(one.new)} {one.unit}, less by "
        f"{number(one.low)} to {number(one.high)} (90 %): {verdict(one)}"
        for one in compared.channels
    ]
    return "\n".join(lines) or "no channel of this log can be held against both machine files"


def pictures_of_compared(compared: Compared) -> Pictures:
    """A stretch and the error over time of each channel, under both machine files."""
    return Pictures(tuple(picture_of(one) for one in compared.channels))


def frame_residuals(found: Diagnosis) -> Any:
    """Measured, predicted and residual of every channel. Raises ValueError, one line."""
    from topdress.console.reports.run_views import parts_of, run_views
    from topdress.control.diagnosis.extend import extend

    columns, machine = _log_of(found)
    views = run_views(columns, machine, extend(machine, found), ())
    parts = parts_of(found.causes)
    columns_out: dict[str, list[Any]] = {name: [] for name in RESIDUAL_COLUMNS}
    for view in views:
        nominal, predicted = view.predict(()), view.predict(view.own(parts))
        columns_out["channel"] += [view.name] * len(view.measured)
        columns_out["unit"] += [view.unit] * len(view.measured)
        columns_out["time_s"] += view.time_s.tolist()
        columns_out["measured"] += view.measured.tolist()
        columns_out["nominal"] += nominal.tolist()
        columns_out["predicted"] += predicted.tolist()
        columns_out["residual"] += (view.measured - predicted).tolist()
    return _frame(found, columns_out)


RESIDUAL_COLUMNS = ("channel", "unit", "time_s", "measured", "nominal", "predicted", "residual")


def _frame(found: Diagnosis, columns: dict[str, list[Any]]) -> Any:
    library = found.frame_library or "pandas"
    try:
        return import_module(library).DataFrame(columns)
    except ImportError:
        raise ValueError(f"a data frame needs {library}: pip install {library}") from None


def _log_of(found: Diagnosis) -> tuple[Any, Machine]:
    if found.seen_with is None:
        raise ValueError(
            "the log that this diagnosis is of is not with it: allowed is one that "
            "diagnose_run gave"
        )
    return found.seen_with


def framed(inside: str) -> str:
    return f'<div class="topdress"><style>{COLOURS}</style>{inside}</div>'


def machine_named(name: str) -> Machine:
    """A machine file by its path, or by its name where it comes with topdress. Raises
    ValueError, one line."""
    from topdress.drivers.files.config import load
    from topdress.drivers.files.config_error import ConfigError
    from topdress.drivers.files.kinds import MACHINE

    try:
        return load(name, MACHINE).model
    except ConfigError as error:
        raise ValueError(error.lines[0]) from None


def format_html(found: Diagnosis) -> str:
    """Verdict, causes, errors by channel."""
    rows = []
    for cause in found.causes:
        value, interval = (
            ("not known", "")
            if cause.size.value is None
            else with_interval(cause.size.value, cause.size.low, cause.size.high)
        )
        rows.append(
            (
                title_of(cause.id),
                cause.id,
                f"{value} {cause.size.unit}",
                interval,
                f"{100.0 * cause.probability:.0f} %",
                cause.advice,
            )
        )
    causes_html = (
        table(("cause", "id", "size", "90 % interval", "probability", "what to do"), rows)
        if rows
        else ""
    )
    channels = table(
        ("channel", "rows", "error (r.m.s.)", "noise", "unit"),
        [
            (one.channel, str(one.n), number(one.rmse), number(one.noise_floor), one.unit)
            for one in found.channels
        ],
        frozenset({1, 2, 3}),
    )
    notes = "".join(
        f"<li>{escape(one)}</li>" for one in (*found.findings, *describe_adoption(found))
    )
    return framed(
        f"<p><b>{escape(VERDICTS[found.verdict][0])}</b>: {escape(sentence(found))}</p>"
        f"{causes_html}{channels}{_predicted(found)}"
        f"{f'<ul>{notes}</ul>' if notes else ''}"
    )


def _predicted(found: Diagnosis) -> str:
    """Errors of each channel on the whole log: of the machine file, of the one with what it
    takes up, of the rival."""

    def cell(value: float | None, over: tuple[str, ...] = ()) -> str:
        return (
            "" if value is None else number(value) + (f" (over {', '.join(over)})" if over else "")
        )

    rows = [
        (
            one.channel,
            number(one.before),
            number(one.file),
            cell(one.said),
            cell(one.rival, one.over),
            one.unit,
        )
        for one in found.predicted
    ]
    return (
        table(
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


def pictures_of(found: Diagnosis) -> Pictures:
    """What `topdress diagnose --report` draws. Raises ValueError, one line, without the log."""
    from topdress.console.reports.pictures import pictures_of as drawn

    columns, machine = _log_of(found)
    tools: dict[str, Any] = {"columns": columns, "machine": machine}
    made = drawn(found, tools)
    every = (
        *(one for several in made.causes for one in several),
        *made.left,
        *made.terms,
        *made.data,
    )
    return Pictures(tuple(one for one in every if one is not None))

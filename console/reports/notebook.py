"""A diagnosis in a notebook: what stands below a cell, and its pictures. Needs no server and no
files of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from console.reports.diagnosis_text import taken_up
from console.reports.html import STYLE, Picture, escape, figure, table
from console.reports.numbers import number, with_interval
from console.reports.said import VERDICTS, sentence, title_of
from control.diagnosis.result import Diagnosis
from control.machine.machine import Machine

COLOURS = STYLE[: STYLE.index("* { box-sizing")].replace(":root", ".topdress")


class Pictures:
    """Pictures of a diagnosis: shown below a notebook's cell, kept with `save`. `svgs`: each by
    itself."""

    def __init__(self, pictures: tuple[Picture, ...]) -> None:
        self.svgs = tuple(one.svg for one in pictures)
        self._html = framed("".join(figure(one) for one in pictures))

    def _repr_html_(self) -> str:
        return self._html

    def save(self, path: str | Path) -> Path:
        """As a page of its own at `path` (.html). Raises OSError."""
        from console.reports.html import page
        from drivers.files.atomic import write_atomically

        place = Path(path)
        write_atomically(place, page("Pictures of a diagnosis", self._html))
        return place


def framed(inside: str) -> str:
    return f'<div class="topdress"><style>{COLOURS}</style>{inside}</div>'


def machine_named(name: str) -> Machine:
    """A machine file by its path, or by its name where it comes with topdress. Raises
    ValueError, one line."""
    from drivers.files.config import load
    from drivers.files.config_error import ConfigError
    from drivers.files.kinds import MACHINE

    try:
        return load(name, MACHINE).model
    except ConfigError as error:
        raise ValueError(error.lines[0]) from None


def html_of(found: Diagnosis) -> str:
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
    notes = "".join(f"<li>{escape(one)}</li>" for one in (*found.findings, *taken_up(found)))
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
    from console.reports.pictures import pictures_of as drawn

    if found.seen_with is None:
        raise ValueError(
            "the log that this diagnosis is of is not with it: allowed is one that "
            "diagnose_run gave"
        )
    columns, machine = found.seen_with
    tools: dict[str, Any] = {"columns": columns, "machine": machine}
    made = drawn(found, tools)
    every = (
        *(one for several in made.causes for one in several),
        *made.left,
        *made.terms,
        *made.data,
    )
    return Pictures(tuple(one for one in every if one is not None))

"""Which pictures does a diagnosis have? They depend on the kind of its data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from topdress.console.reports import run_pictures, table_pictures
from topdress.console.reports.chart import AFTER_COLOUR, PAPER_COLOUR, THIRD_COLOUR, ChartSheet
from topdress.console.reports.html import Picture
from topdress.console.reports.run_views import list_effect_instances, make_run_views
from topdress.console.reports.table_views import COARSE_CLOCK, make_table_views
from topdress.console.reports.term_words import describe_term, name_variable
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.result import Diagnosis, TermFound


def draw_term(found: TermFound) -> Picture | None:
    """Returns a picture of a term and the means of the data, class by class of its variable; None
    for data without means."""
    if not found.seen:
        return None
    at, seen, by_term = np.array(found.seen).T
    over = found.term["over"]
    product = len(over) > 1
    label = f"what the term says, {found.unit}" if product else name_variable(over[0]["name"])
    sheet = ChartSheet(6.4, 3.4)
    panel, order = sheet.panel, np.argsort(at)
    panel.draw_level(0.0)
    panel.plot(at[order], by_term[order], THIRD_COLOUR, width=2.0, label="the term")
    panel.plot(
        at, seen, AFTER_COLOUR, dash="", marker="s", fill=PAPER_COLOUR, label="means of the data"
    )
    panel.label(label, f"{found.stage} over nominal, {found.unit}", found.term["id"])
    return sheet.make_picture(
        describe_term(found.term),
        f"{describe_term(found.term)}. Squares are the data's own means in classes of equally "
        "many rows, "
        "the line is the mean of the term there.",
    )


class PictureSet(NamedTuple):
    """Holds the pictures of a diagnosis.

    `causes` has one entry for each cause, `left` one for each unexplained part, `data` the pictures
    of the whole data.
    """

    causes: tuple[tuple[Picture, ...], ...]
    left: tuple[Picture | None, ...]
    data: tuple[Picture, ...]
    # One entry for each term.
    terms: tuple[Picture | None, ...] = ()


def draw_pictures(found: Diagnosis, tools: Mapping[str, Any]) -> PictureSet:
    """Returns all pictures; none of the data where `tools` has neither columns nor tables."""
    if "columns" in tools:
        return _draw_run_pictures(found, tools)
    if "tables" in tools:
        return _draw_table_pictures(found, tools)
    return PictureSet(tuple(() for _ in found.causes), tuple(None for _ in found.unexplained), ())


def _draw_run_pictures(found: Diagnosis, tools: Mapping[str, Any]) -> PictureSet:
    of_this_run = list_effect_instances(
        [
            cause
            for cause in found.causes
            if cause.onset_s is not None or cause.until_s is not None or cause.grows
        ]
    )
    views = make_run_views(
        tools["columns"], tools["machine"], extend(tools["machine"], found), of_this_run
    )
    parts = list_effect_instances(found.causes)
    causes = []
    for cause in found.causes:
        own = list_effect_instances([cause])
        causes.append(tuple(run_pictures.draw_cause(views, parts, own[0])) if own else ())
    left = []
    for k, one in enumerate(found.unexplained):
        fit = found.tables[k] if k < len(found.tables) else None
        left.append(run_pictures.draw_unexplained(views, parts, one, fit))
    over_time = run_pictures.draw_time_lines(views, parts)
    terms = tuple(draw_term(one) for one in found.terms)
    return PictureSet(tuple(causes), tuple(left), (over_time,) if over_time else (), terms)


def _draw_table_pictures(found: Diagnosis, tools: Mapping[str, Any]) -> PictureSet:
    views = make_table_views(tools["tables"], tools["machine"], found.causes)
    causes = []
    for cause in found.causes:
        phase = None
        if cause.id == COARSE_CLOCK and cause.size.value:
            phase = table_pictures.draw_clock_phases(views, cause.size.value)
        causes.append((phase,) if phase else ())
    left = tuple(table_pictures.draw_table_unexplained(views, one) for one in found.unexplained)
    return PictureSet(
        tuple(causes),
        left,
        tuple(table_pictures.draw_table_column(view) for view in views),
    )

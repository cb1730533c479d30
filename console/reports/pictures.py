"""Which pictures a diagnosis has: by the kind of its data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from topdress.console.reports import run_pictures, table_pictures
from topdress.console.reports.chart import AFTER, PAPER, THIRD, ChartSheet
from topdress.console.reports.html import Picture
from topdress.console.reports.run_views import parts_of, run_views
from topdress.console.reports.table_views import IN_STEPS, table_views
from topdress.console.reports.term_words import sentence, variable_name
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.result import Diagnosis, TermFound


# A term next to what the data themselves say, class by class of its variable.
def term_picture(found: TermFound) -> Picture | None:
    """None where the data hold no means to show."""
    if not found.seen:
        return None
    at, seen, by_term = np.array(found.seen).T
    over = found.term["over"]
    product = len(over) > 1
    label = f"what the term says, {found.unit}" if product else variable_name(over[0]["name"])
    sheet = ChartSheet(6.4, 3.4)
    panel, order = sheet.panel, np.argsort(at)
    panel.draw_level(0.0)
    panel.plot(at[order], by_term[order], THIRD, width=2.0, label="the term")
    panel.plot(at, seen, AFTER, dash="", marker="s", fill=PAPER, label="means of the data")
    panel.label(label, f"{found.stage} over nominal, {found.unit}", found.term["id"])
    return sheet.make_picture(
        sentence(found.term),
        f"{sentence(found.term)}. Squares are the data's own means in classes of equally "
        "many rows, "
        "the line is the mean of the term there.",
    )


class PictureSet(NamedTuple):
    """`causes`: one entry for each cause; `left`: one for each entry of unexplained; `data`: of
    the whole."""

    causes: tuple[tuple[Picture, ...], ...]
    left: tuple[Picture | None, ...]
    data: tuple[Picture, ...]
    terms: tuple[Picture | None, ...] = ()  # one for each term


def pictures_of(found: Diagnosis, tools: Mapping[str, Any]) -> PictureSet:
    """All pictures; none of the data where `tools` holds neither columns nor tables."""
    if "columns" in tools:
        return _of_run(found, tools)
    if "tables" in tools:
        return _of_tables(found, tools)
    return PictureSet(tuple(() for _ in found.causes), tuple(None for _ in found.unexplained), ())


def _of_run(found: Diagnosis, tools: Mapping[str, Any]) -> PictureSet:
    of_this_run = parts_of(
        [
            cause
            for cause in found.causes
            if cause.onset_s is not None or cause.until_s is not None or cause.grows
        ]
    )
    views = run_views(
        tools["columns"], tools["machine"], extend(tools["machine"], found), of_this_run
    )
    parts = parts_of(found.causes)
    causes = []
    for cause in found.causes:
        own = parts_of([cause])
        causes.append(tuple(run_pictures.cause_pictures(views, parts, own[0])) if own else ())
    left = []
    for k, one in enumerate(found.unexplained):
        fit = found.tables[k] if k < len(found.tables) else None
        left.append(run_pictures.left_picture(views, parts, one, fit))
    over_time = run_pictures.draw_time_lines(views, parts)
    terms = tuple(term_picture(one) for one in found.terms)
    return PictureSet(tuple(causes), tuple(left), (over_time,) if over_time else (), terms)


def _of_tables(found: Diagnosis, tools: Mapping[str, Any]) -> PictureSet:
    views = table_views(tools["tables"], tools["machine"], found.causes)
    causes = []
    for cause in found.causes:
        phase = None
        if cause.id == IN_STEPS and cause.size.value:
            phase = table_pictures.phase_picture(views, cause.size.value)
        causes.append((phase,) if phase else ())
    left = tuple(table_pictures.left_picture(views, one) for one in found.unexplained)
    return PictureSet(
        tuple(causes),
        left,
        tuple(table_pictures.table_picture(view) for view in views),
    )

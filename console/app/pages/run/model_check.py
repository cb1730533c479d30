"""One line on the Run page: how the machine departs from its model, since when, probably why.

It is empty while the machine turns; at hold it also says what can be done about it.
"""
from __future__ import annotations

from rich.cells import cell_len
from textual.content import Content

from console.app.view import duration, wall_clock
from console.app.widgets.panel import Panel, fit, line
from console.frame import Frame
from console.locale import _
from console.reports.live_words import departure_line, offer, todo
from control.diagnosis.result import Departure
from control.orders import State


class ModelCheck(Panel[tuple[str, ...]]):
    """The line, in the fullest of its forms that fits; hidden by the page while there is nothing to say."""

    def lines(self, view: tuple[str, ...], width: int, height: int) -> list[Content]:
        text = next((text for text in view if cell_len(text) <= width), view[-1] if view else "")
        return [line((fit(text, width), "$warning" if text else ""))]


def model_check_texts(found: Departure, frame: Frame, utc_offset_s: float) -> tuple[str, ...]:
    """What is said, the fullest form first; nothing while the machine turns. utc_offset_s: local time minus UTC.

    At work the name counts for more than the time; at hold what can be done counts for more than both.
    """
    if turns(frame):
        return ()
    since = ""
    if found.since_s is not None:
        since = wall_clock(frame.row.utc, utc_offset_s, frame.row.time_s - found.since_s)[:5] or duration(found.since_s)
    full, named, dated, plain = (departure_line(found, time, why) for time, why in
                                 ((since, True), ("", True), (since, False), ("", False)))
    if frame.row.state == State.HELD:
        pairs = [(full, todo(found)), (full, offer(found)), (named, offer(found)), (dated, offer(found)),
                 (plain, offer(found))]
    else:
        pairs = [(said, "F9") for said in (full, named, dated, plain)]
    forms = [_("check: {said}; {todo}").format(said=said, todo=end) for said, end in pairs]
    return (*forms, _("check: {said}; {todo}").format(said=plain, todo="F9"))


def turns(frame: Frame) -> bool:
    """Whether the machine works and yet spreads nothing here: a headland, a turn."""
    row = frame.row
    return row.state == State.WORKING and (row.work_switch == 0 or not row.target_rate_kg_ha)

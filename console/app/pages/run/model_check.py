"""One line on the Run page: how the machine departs from its model, since when, probably why.

It is empty while the machine turns; at hold it also says what can be done about it.
"""
from __future__ import annotations

from textual.content import Content

from console.app.view import duration, wall_clock
from console.app.widgets.panel import Panel, fit, line
from console.frame import Frame
from console.locale import _
from console.reports.live_words import departure_line, todo
from control.diagnosis.live.departure import Departure
from control.orders import State


class ModelCheck(Panel[str]):
    """The line; hidden by the page while there is nothing to say."""

    def lines(self, view: str, width: int, height: int) -> list[Content]:
        return [line((fit(view, width), "$warning" if view else ""))]


def model_check_text(found: Departure, frame: Frame, utc_offset_s: float) -> str:
    """Empty while the machine turns. utc_offset_s: local time minus UTC."""
    if turns(frame):
        return ""
    since = ""
    if found.since_s is not None:
        since = wall_clock(frame.row.utc, utc_offset_s, frame.row.time_s - found.since_s)[:5] or duration(found.since_s)
    end = todo(found) if frame.row.state == State.HELD else "F9"
    return _("model check: {said}; {todo}").format(said=departure_line(found, since), todo=end)


def turns(frame: Frame) -> bool:
    """Whether the machine works and yet spreads nothing here: a headland, a turn."""
    row = frame.row
    return row.state == State.WORKING and (row.work_switch == 0 or not row.target_rate_kg_ha)

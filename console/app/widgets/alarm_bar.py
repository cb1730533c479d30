"""The alarms: word, symbol, text, place, first time, what to do. A click acknowledges."""
from __future__ import annotations

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.view import AlarmLine, AlarmsView
from console.app.widgets.panel import Panel, fit, spread
from console.locale import _
from control.orders import Severity


def _style(alarm: AlarmLine) -> str:
    name = "red" if alarm.severity is Severity.RED else "amber"
    if alarm.acknowledged:
        return "$muted"
    return f"$on-alarm-{name} on $alarm-{name}"


def _cells(parts: list[tuple[str, str]]) -> int:
    return sum(cell_len(text) for text, _style in parts)


class AlarmBar(Panel[AlarmsView]):
    """Two rows for the worst alarm (what it is; what to do), one each for the next ones, as far as there is room."""

    def lines(self, view: AlarmsView, width: int, height: int) -> list[Content]:
        if not view.lines:
            return [Content.assemble((fit(f"   {view.calm}", width), "$muted"))]
        rows: list[Content] = []
        for index, alarm in enumerate(view.lines):
            room = height - len(rows)
            if room <= 0:
                break
            more = len(view.lines) - index - 1
            if index == 0:
                rows.append(self._first(alarm, width, more if height == 1 else 0))
                if height > 1 and alarm.todo:
                    rows.append(self._todo(alarm, width))
            else:
                rows.append(self._first(alarm, width, more if room == 1 else 0))
        return rows

    def _first(self, alarm: AlarmLine, width: int, more: int) -> Content:
        style = _style(alarm)
        place = f"{alarm.place}: " if alarm.place else ""
        left = [(f" {alarm.symbol} {alarm.word} ", f"bold {style}"), (f" {place}{alarm.text} ", style)]
        rest = [(f" {_('+{count} more').format(count=more)} ", "bold reverse")] if more else []
        since = f" {alarm.since} ({alarm.lasted}) " if alarm.since else f" {alarm.lasted} "
        if _cells(left + rest) + cell_len(since) > width and alarm.since:
            since = f" {alarm.since} "            # the text matters more than how long ago
        end = [(since, style), *rest]
        used = _cells(left + end)
        left.append((" " * max(0, width - used), style))
        return spread([*left], [*end], width)

    def _todo(self, alarm: AlarmLine, width: int) -> Content:
        style = _style(alarm)
        hint = "" if alarm.acknowledged or alarm.severity is not Severity.RED else f" {_('A: acknowledge')} "
        text = fit(f"   {alarm.todo}", width - cell_len(hint))
        return Content.assemble((text, style), (hint, f"bold {style}"))

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        await self.run_action("app.do('acknowledge')")

"""The alarms: word, symbol, text, place, first time, what to do. A click acknowledges."""
from __future__ import annotations

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.view import AlarmLine, AlarmsView
from console.app.widgets.panel import Panel, Part, fit, line, spread
from console.app.widgets.wrap import wrapped
from console.locale import _
from control.orders import Severity

LEAST_BIG = 7              # rows: from here on a fault is written out


def _styles(alarm: AlarmLine) -> tuple[str, str]:
    """Of the word, and of the rest of the row. The whole row is in colour only while somebody still has to look; the
    word alone stays so while the cause is there, and is black where it is gone."""
    name = "red" if alarm.severity is Severity.RED else "amber"
    colour = f"$on-alarm-{name} on $alarm-{name}"
    if alarm.gone:
        return "bold $background on $foreground", "bold"
    return f"bold {colour}", "bold" if alarm.acknowledged else colour


def _cells(parts: list[tuple[str, str]]) -> int:
    return sum(cell_len(text) for text, _style in parts)


class AlarmBar(Panel[AlarmsView]):
    """Two rows for the worst alarm (what it is; what to do), one each for the next ones, as far as there is room. A
    fault is written out where the page gives it the rows."""

    def lines(self, view: AlarmsView, width: int, height: int) -> list[Content]:
        if not view.lines:
            style = "bold $background on $foreground" if view.urgent else "$muted"
            rows = wrapped(view.calm, max(10, width - 6))[:height] if view.urgent else [view.calm]
            return [Content.assemble((fit(f"   {row}", width), style)) for row in rows]
        if view.fault and height >= LEAST_BIG:
            return self._fault(view, width, height)
        return self._rows(view.lines, width, height)

    def _rows(self, alarms: tuple[AlarmLine, ...], width: int, height: int) -> list[Content]:
        rows: list[Content] = []
        for index, alarm in enumerate(alarms):
            room = height - len(rows)
            if room <= 0:
                break
            more = len(alarms) - index - 1
            if index == 0:
                rows.append(self._first(alarm, width, more if height == 1 else 0))
                if height > 1 and alarm.todo:
                    rows.append(self._todo(alarm, width))
            else:
                rows.append(self._first(alarm, width, more if room == 1 else 0))
        return rows

    def _first(self, alarm: AlarmLine, width: int, more: int) -> Content:
        word, style = _styles(alarm)
        place = f"{alarm.place}: " if alarm.place else ""
        left = [(f" {alarm.symbol} {alarm.word} ", word), (f" {place}{alarm.text} ", style)]
        rest = [(f" {_('+{count} more').format(count=more)} ", "bold reverse")] if more else []
        if alarm.gone:
            since = f" {alarm.gone} "
        else:
            since = f" {alarm.since} ({alarm.lasted}) " if alarm.since else f" {alarm.lasted} "
            if _cells(left + rest) + cell_len(since) > width and alarm.since:
                since = f" {alarm.since} "            # the text matters more than how long ago
        end = [(since, style), *rest]
        used = _cells(left + end)
        left.append((" " * max(0, width - used), style))
        return spread([*left], [*end], width)

    def _todo(self, alarm: AlarmLine, width: int) -> Content:
        _word, style = _styles(alarm)
        hint = f" {_acknowledging(alarm)} " if _acknowledging(alarm) else ""
        text = fit(f"   {alarm.todo}", width - cell_len(hint))
        return Content.assemble((text, style), (hint, style if style.startswith("bold") else f"bold {style}"))

    def _fault(self, view: AlarmsView, width: int, height: int) -> list[Content]:
        """What is wrong, where, since when, and what to do about it, step by step; the other alarms below."""
        alarm = next((one for one in view.lines if one.id == view.fault), view.lines[0])
        colour = "$on-alarm-red on $alarm-red"

        def band(text: str, end: str = "") -> Content:
            return line((fit(f"  {text}", width - cell_len(end)), f"bold {colour}"), (end, f"bold {colour}"))

        since = f"{alarm.since} ({alarm.lasted})  " if alarm.since else f"{alarm.lasted}  "
        steps = [alarm.todo] if alarm.todo else []
        if not alarm.acknowledged:
            steps.append(_("A: acknowledge the alarm."))
        steps.append(_("R: make the machine ready; it stays in fault while the cause is there."))
        rows = [band(""), band(f"{alarm.symbol}  {_('FAULT')}   {alarm.place}", since), band(alarm.text), band("")]
        rows.append(line((fit(f"  {alarm.gone or _('The cause is still there.')}", width), "bold")))
        for number, step in enumerate(steps, 1):
            for index, text in enumerate(wrapped(step, max(10, width - 8))):
                lead: Part = (f"   {number}  " if not index else "      ", "bold $primary")
                rows.append(line(lead, (text, "bold")))
        others = tuple(one for one in view.lines if one is not alarm)
        room = height - len(rows)
        return rows[:height] + (self._rows(others, width, room)[:room] if others and room > 0 else [])

    def places(self) -> tuple[tuple[int, int], ...]:
        return ((0, 0),) if self.view.lines else ()

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        await self.run_action("app.do('acknowledge')")


def _acknowledging(alarm: AlarmLine) -> str:
    """Whether somebody must, or has; amber alarms need nobody."""
    if alarm.severity is not Severity.RED:
        return ""
    return _("acknowledged") if alarm.acknowledged else _("A: acknowledge")

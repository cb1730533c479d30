"""Shows the alarms: word, symbol, text, place, first time, remedy. A click acknowledges."""

from __future__ import annotations

from rich.cells import cell_len
from textual import events
from textual.content import Content
from topdress.console.app.panel_views import AlarmLine, AlarmsView
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    choose_longest_fit,
    fit_text_width,
    make_line,
    wrap_text,
)
from topdress.console.locale import _
from topdress.control.orders import Severity

# From this number of rows a fault is shown in full.
MIN_FAULT_ROWS = 7


def _choose_styles(alarm: AlarmLine) -> tuple[str, str]:
    """Return the styles of the word and of the rest of the row.

    The whole row is coloured while somebody must act. After acknowledging only the word is coloured
    while the cause exists; without a cause the word is inverted.
    """
    # The theme has a pair of colours for each severity.
    name = "red" if alarm.severity is Severity.RED else "amber"
    colour = f"$on-alarm-{name} on $alarm-{name}"
    if alarm.gone:
        return "bold $background on $foreground", "bold"
    return f"bold {colour}", "bold" if alarm.acknowledged else colour


def _count_cells(parts: list[tuple[str, str]]) -> int:
    """Return the number of cells of parts."""
    return sum(cell_len(text) for text, _style in parts)


class AlarmBar(Panel[AlarmsView]):
    """Shows the alarms. The worst alarm is shown in full (text, remedy); the next alarms follow as
    far as whole rows have room. A fault has its own form where the page provides the rows."""

    def draw_rows(self, view: AlarmsView, width: int, height: int) -> list[Content]:
        if not view.lines:
            style = "bold $background on $foreground" if view.urgent else "$muted"
            return [
                Content.assemble((fit_text_width(f"   {row}", width), style))
                for row in _wrap_calm(view, width)[:height]
            ]
        # With fewer rows a fault is shown like any other alarm.
        if view.fault and height >= MIN_FAULT_ROWS:
            return self._draw_fault(view, width, height)
        return _draw_alarms(view.lines, width, height)

    def _draw_fault(self, view: AlarmsView, width: int, height: int) -> list[Content]:
        """Return the fault with place, time and remedy step by step, and the other alarms below."""
        # The alarm of the fault may have ended while others remain.
        alarm = next((one for one in view.lines if one.id == view.fault), view.lines[0])
        colour = "$on-alarm-red on $alarm-red"

        def draw_band(text: str, end: str = "") -> Content:
            return make_line(
                (fit_text_width(f"  {text}", width - cell_len(end)), f"bold {colour}"),
                (end, f"bold {colour}"),
            )

        since = f"{_format_since(alarm)}  "
        steps = [alarm.todo] if alarm.todo else []
        if not alarm.acknowledged:
            steps.append(_("A: acknowledge the alarm."))
        # Each step begins with its key, in the order in which the operator needs them.
        steps.append(_("R: make the machine ready; it stays in fault while the cause is there."))
        rows = [
            draw_band(""),
            draw_band(f"{alarm.symbol}  {_('FAULT')}   {alarm.place}", since),
            *(draw_band(row) for row in wrap_text(alarm.text, width - 3)),
            draw_band(""),
        ]
        rows.append(
            make_line(
                (fit_text_width(f"  {alarm.gone or _('The cause is still there.')}", width), "bold")
            )
        )
        for number, step in enumerate(steps, 1):
            for index, text in enumerate(wrap_text(step, max(10, width - 8))):
                lead: TextPart = (f"   {number}  " if not index else "      ", "bold $primary")
                rows.append(make_line(lead, (text, "bold")))
        # A fault must not hide a second alarm.
        others = tuple(one for one in view.lines if one is not alarm)
        room = height - len(rows)
        return rows[:height] + (
            _draw_alarms(others, width, room)[:room] if others and room > 0 else []
        )

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        return ((0, 0),) if self.view.lines else ()

    async def on_click(self, event: events.Click) -> None:
        """Acknowledge the alarms."""
        event.stop()
        await self.run_action("app.do('acknowledge')")


def count_rows_needed(view: AlarmsView, width: int, todo: bool = True) -> int:
    """Return the number of rows that show the worst alarm in full, and the count of the others."""
    if not view.lines:
        return len(_wrap_calm(view, width))
    # The view is sorted, so the first alarm is the worst.
    first = view.lines[0]
    return len(_draw_full_alarm(first, width, todo)) + (len(view.lines) > 1)


def _wrap_calm(view: AlarmsView, width: int) -> list[str]:
    """Lay out calm parts without breaking a part across rows; an urgent text wraps."""
    if view.urgent:
        return wrap_text(view.calm, max(10, width - 6))
    rows: list[str] = []
    for part in (view.calm, *view.about):
        # A part starts a new row if it does not fit completely.
        if rows and cell_len(f"{rows[-1]}   {part}") <= width - 3:
            rows[-1] += f"   {part}"
        else:
            rows.append(part)
    return rows


def _draw_alarms(alarms: tuple[AlarmLine, ...], width: int, height: int) -> list[Content]:
    """Return the worst alarm in full and the next alarms as far as whole rows have room; the
    remaining alarms are counted."""
    # With a single row the remedy has no room.
    rows = _draw_full_alarm(alarms[0], width, height > 1)[: max(1, height)]
    for index, alarm in enumerate(alarms[1:], 1):
        left, room = len(alarms) - index, height - len(rows)
        text = _draw_full_alarm(alarm, width, False)
        # The row of the count is reserved while more alarms follow.
        if len(text) + (left > 1) <= room:
            rows += text
            continue
        more = f" {_('+{count} more').format(count=left - 1)} " if left > 1 else ""
        one = _draw_one_row(alarm, width, more)
        if room > 0:
            rows.append(
                one
                or make_line(
                    (
                        f" {_('+{count} more').format(count=left)}  {_('! shows all')} ",
                        "bold reverse",
                    )
                )
            )
        elif len(_draw_full_alarm(alarms[0], width, False)) == 1:
            rows[0] = (
                _draw_one_row(alarms[0], width, f" {_('+{count} more').format(count=left)} ")
                or rows[0]
            )
        break
    return rows


def _draw_one_row(alarm: AlarmLine, width: int, more: str) -> Content | None:
    """Return word, text and time in one row, the time only where it fits; None if even the text
    does not fit."""
    word, style = _choose_styles(alarm)
    left = [(f" {alarm.symbol} {alarm.word} ", word), (f" {_format_with_place(alarm)} ", style)]
    rest = [(more, "bold reverse")] if more else []
    # The text has priority over the time.
    spare = width - _count_cells(left + rest)
    if spare < 0:
        return None
    when = choose_longest_fit((*(f" {form} " for form in _list_time_forms(alarm)), ""), spare)
    return make_line(*left, (" " * (spare - cell_len(when)), style), (when, style), *rest)


def _draw_full_alarm(alarm: AlarmLine, width: int, todo: bool) -> list[Content]:
    """Return the full text of an alarm, then its remedy with the note about acknowledging at the
    end."""
    word, style = _choose_styles(alarm)
    # The hint at the end is bold, whatever the style of the row.
    bold = style if style.startswith("bold") else f"bold {style}"
    first = _draw_one_row(alarm, width, "")
    rows = [first] if first is not None else []
    if first is None:
        lead = f" {alarm.symbol} {alarm.word} "
        texts = wrap_text(_format_with_place(alarm), width - cell_len(lead) - 2)
        rows = [
            make_line(
                (lead if not k else " " * cell_len(lead), word),
                (fit_text_width(f" {text}", width - cell_len(lead)), style),
            )
            for k, text in enumerate(texts)
        ]
    if not todo:
        return rows
    hint = f" {_format_acknowledging(alarm)} " if _format_acknowledging(alarm) else ""
    steps = wrap_text(alarm.todo, width - 4) if alarm.todo else []
    # The last row is wrapped again if the hint would not fit behind it.
    if steps and cell_len(steps[-1]) + 3 + cell_len(hint) > width:
        steps = wrap_text(alarm.todo, width - 4 - cell_len(hint))
    for k, text in enumerate(steps or ([""] if hint else [])):
        end = hint if k >= len(steps) - 1 else ""
        rows.append(
            make_line((fit_text_width(f"   {text}", width - cell_len(end)), style), (end, bold))
        )
    return rows


def _format_with_place(alarm: AlarmLine) -> str:
    """Return the text with its place."""
    return f"{alarm.place}: {alarm.text}" if alarm.place else alarm.text


def _format_since(alarm: AlarmLine) -> str:
    """Return the time of day of the beginning, else the duration."""
    return (
        f"{alarm.since} ({alarm.lasted})"
        if alarm.since
        else _("for {duration}").format(duration=alarm.lasted)
    )


def _list_time_forms(alarm: AlarmLine) -> tuple[str, ...]:
    """Return since when the alarm exists, or since when its cause has ended; fullest form first."""
    seen = f"{_('acknowledged')}  " if alarm.acknowledged else ""
    if alarm.gone:
        return f"{seen}{alarm.gone}", alarm.gone
    return (
        f"{seen}{_format_since(alarm)}",
        *((f"{seen}{alarm.since}",) if alarm.since else ()),
        _format_since(alarm),
        alarm.since,
    )


def _format_acknowledging(alarm: AlarmLine) -> str:
    """Return whether the alarm must be or was acknowledged; "" for amber alarms, which need no
    acknowledgement."""
    if alarm.severity is not Severity.RED:
        return ""
    return _("acknowledged") if alarm.acknowledged else _("A: acknowledge")

"""Where in the log the replay stands, how fast it runs, and whether it is the log or a what-if. A click seeks."""
from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.message import Message

from console.app.widgets.panel import Panel, Part, fit, line, spread
from console.locale import _

if TYPE_CHECKING:
    from console.app.app import TopdressApp


class ReplayView(NamedTuple):
    name: str
    playing: bool
    speed: str
    at: str
    end: str
    share: float              # of the log, rounded to what a wide bar can show
    mode: str                 # "as recorded", or what is other
    other: bool
    findings: int
    busy: str
    alarm_shares: tuple[float, ...] = ()
    changed: str = ""         # what a what-if would have changed; in the place of the log's name


class ReplayBar(Panel[ReplayView]):
    """Two rows: what is played; the time line with marks where alarms begin."""

    class Seek(Message):
        """The time line was clicked at this share of the log."""

        def __init__(self, share: float) -> None:
            super().__init__()
            self.share = share

    class Cancel(Message):
        """The word that something is computed was clicked."""

    def lines(self, view: ReplayView, width: int, height: int) -> list[Content]:
        symbol, word = ("▸", _("playing")) if view.playing else ("▮▮", _("paused"))
        left: list[Part] = [(f" {symbol} {word} ", "bold"), (f" {view.speed} ", "bold $primary"),
                            (f" {view.mode} ", "bold reverse" if view.other else "$muted"),
                            f" {view.changed or view.name}"]
        return [spread(left, self._end(view), width), self._time_line(view, width)]

    def _end(self, view: ReplayView) -> list[Part]:
        """What is computed has the right end alone: a click on it cancels."""
        if view.busy:
            return [(f" {view.busy} ", "bold reverse")]
        if view.findings:
            key = cast("TopdressApp", self.app).shown_key("findings")
            return [(f" {key}: {_('findings')} {view.findings} ", "bold $on-alarm-amber on $alarm-amber")]
        return []

    def _end_cells(self, view: ReplayView) -> int:
        return sum(cell_len(part if isinstance(part, str) else part[0]) for part in self._end(view))

    @staticmethod
    def _ends(view: ReplayView) -> tuple[str, str]:
        return f" {view.at} ", f" {view.end} "

    def _time_line(self, view: ReplayView, width: int) -> Content:
        first, last = self._ends(view)
        room = max(4, width - cell_len(first) - cell_len(last))
        at = round(view.share * (room - 1))
        alarms = {round(share * (room - 1)) for share in view.alarm_shares}
        parts: list[Part] = [(first, "bold")]
        for cell in range(room):
            if cell == at:
                parts.append(("┃", "bold $foreground on $track"))
            elif cell in alarms:
                parts.append(("!", "bold $on-alarm-red on $alarm-red"))
            else:
                parts.append(("━" if cell < at else "─", "$primary" if cell < at else "$muted"))
        return line(*parts, (fit(last, cell_len(last)), "$muted"))

    def places(self) -> tuple[tuple[int, int], ...]:
        """The word that something is computed, and the ends of the log."""
        width = self.content_size.width
        first, last = (cell_len(text) for text in self._ends(self.view))
        cancel = ((width - self._end_cells(self.view), 0),) if self.view.busy else ()
        return (*cancel, (first, 1), (width - last - 1, 1))

    def on_click(self, event: events.Click) -> None:
        if event.y == 0 and self.view.busy and event.x >= self.content_size.width - self._end_cells(self.view):
            event.stop()
            self.post_message(self.Cancel())
            return
        first, last = self._ends(self.view)
        room = self.content_size.width - cell_len(first) - cell_len(last)
        if event.y == 1 and 0 <= event.x - cell_len(first) < room:
            event.stop()
            self.post_message(self.Seek((event.x - cell_len(first)) / max(1, room - 1)))

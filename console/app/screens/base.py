"""What Run and Replay share: the panels, where they stand at each size, and how often they are looked at."""
from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.screen import Screen
from textual.widgets import Static

from console.app import actions
from console.app.history import Point, Spot
from console.app.pace import MAPS_S, NUMBERS_S, PLOTS_S, Pace
from console.app.view import STALE_S, RunView, look
from console.app.widgets.alarm_bar import AlarmBar
from console.app.widgets.canvas import Canvas
from console.app.widgets.field_map import FieldMap, MapView
from console.app.widgets.heads import Heads
from console.app.widgets.items import Items
from console.app.widgets.key_bar import KeyBar, KeysView
from console.app.widgets.panel import Panel
from console.app.widgets.rates import Rates
from console.app.widgets.status_line import StatusLine
from console.app.widgets.tiles import Tiles
from console.app.widgets.trend import Trend, TrendView
from console.frame import Frame
from console.locale import _, in_use

if TYPE_CHECKING:
    from console.app.app import TopdressApp

LEAST_COLUMNS, LEAST_ROWS = 80, 24


class PanelScreen(Screen[None]):
    """Trends go below 36 rows, then the map below 100 columns; below 80 x 24 only state, alarms and keys are left."""

    AUTO_FOCUS = ""
    where: ClassVar[str] = actions.ANYWHERE
    HORIZONTAL_BREAKPOINTS = [(0, "-tiny-columns"), (LEAST_COLUMNS, "-narrow"), (100, "-wide")]
    VERTICAL_BREAKPOINTS = [(0, "-tiny-rows"), (LEAST_ROWS, "-low"), (28, "-middle"), (36, "-tall")]

    if TYPE_CHECKING:
        @property
        def app(self) -> TopdressApp: ...

    def __init__(self) -> None:
        super().__init__(classes="panels")
        self._numbers, self._plots, self._maps = Pace(NUMBERS_S), Pace(PLOTS_S), Pace(MAPS_S)

    def compose(self) -> ComposeResult:
        view = look(None, 0.0, self.app.units)
        yield StatusLine(view.status, id="status")
        yield AlarmBar(view.alarms, id="alarms")
        yield from self.extra()
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield Rates(view.rates, id="rates")
                yield Tiles(view.tiles, id="tiles")
                yield Heads(view.heads, id="heads")
                yield Items(view.items, id="items-low")
                yield Trend(TrendView((), self.app.units.rate), id="trend")
            with Vertical(id="right"):
                yield FieldMap(MapView((), None, None, self.app.units.rate, self.app.units.distance), id="map")
                yield Items(view.items, id="items-side")
        yield Static("", id="too-small", markup=False)
        yield KeyBar(KeysView((), False, "", in_use()), id="keys")

    def extra(self) -> ComposeResult:
        """Panels between the alarms and the body."""
        yield from ()

    def on_resize(self, event: events.Resize) -> None:
        self.query_one("#too-small", Static).update(
            _("This terminal is {width} x {height}; the console needs {columns} x {rows}.").format(
                width=event.size.width, height=event.size.height, columns=LEAST_COLUMNS, rows=LEAST_ROWS))

    def hurry(self) -> None:
        """Everything is looked at with the next tick."""
        for pace in (self._numbers, self._plots, self._maps):
            pace.hurry()

    def redraw(self) -> None:
        """After another language or theme: views may be equal and yet look different."""
        self.hurry()
        for panel in self.query(Panel):
            panel.refresh()
        for canvas in self.query(Canvas):
            canvas._painted_for = None
            canvas.refresh()

    def tick(self, now_s: float) -> None:
        """Look at what is new; called often, does only what is due."""
        frame, age_s = self.seen(now_s)
        if self._numbers.due(now_s):
            self.show_numbers(self.seen_view(frame, age_s))
        if self._plots.due(now_s) and self.query_one("#trend").display:
            self.query_one("#trend", Trend).show(TrendView(self.points(), self.app.units.rate, age_s > STALE_S))
        if self._maps.due(now_s) and self.query_one("#right").display:
            place = frame.place_m if frame else None
            heading = frame.row.heading_deg if frame else None
            self.query_one("#map", FieldMap).show(MapView(self.spots(), place, heading, self.app.units.rate,
                                                          self.app.units.distance, age_s > STALE_S))

    def seen_view(self, frame: Frame | None, age_s: float) -> RunView:
        return look(frame, age_s, self.app.units, self.app.utc_offset_s, self.marks())

    def show_numbers(self, view: RunView) -> None:
        self.query_one("#status", StatusLine).show(view.status)
        self.query_one("#alarms", AlarmBar).show(view.alarms)
        self.query_one("#rates", Rates).show(view.rates)
        self.query_one("#tiles", Tiles).show(view.tiles)
        self.query_one("#heads", Heads).show(view.heads)
        for items in self.query(Items):
            items.show(view.items)
        self.show_keys()

    def show_keys(self) -> None:
        self.query_one("#keys", KeyBar).show(
            KeysView(actions.at(self.where), self.app.locked, self.app.notice_text, in_use()))

    def marks(self) -> tuple[str, ...]:
        """Words that stand in the status line until they are untrue."""
        return (_("LOCKED"),) if self.app.locked else ()

    def seen(self, now_s: float) -> tuple[Frame | None, float]:
        """The frame to show, and its age in s."""
        raise NotImplementedError

    def points(self) -> tuple[Point, ...]:
        raise NotImplementedError

    def spots(self) -> tuple[Spot, ...]:
        raise NotImplementedError

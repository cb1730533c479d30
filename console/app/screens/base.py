"""What Run and Replay share: the panels and where they stand at each size."""
from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Vertical

from console.app.history import Point, Spot
from console.app.screens.page import Page
from console.app.view import STALE_S, RunView, look
from console.app.widgets.field_map import FieldMap, MapView
from console.app.widgets.heads import Heads
from console.app.widgets.items import Items
from console.app.widgets.rates import Rates
from console.app.widgets.tiles import Tiles
from console.app.widgets.trend import Trend, TrendView


class PanelScreen(Page):
    """Trends go below 36 rows, then the map below 100 columns."""

    def body(self) -> ComposeResult:
        view = look(None, 0.0, self.app.units)
        with Vertical(id="left"):
            yield Rates(view.rates, id="rates")
            yield Tiles(view.tiles, id="tiles")
            yield Heads(view.heads, id="heads")
            yield Items(view.items, id="items-low")
            yield Trend(TrendView((), self.app.units.rate), id="trend")
        with Vertical(id="right"):
            yield FieldMap(MapView((), None, None, self.app.units.rate, self.app.units.distance), id="map")
            yield Items(view.items, id="items-side")

    def tick(self, now_s: float) -> None:
        super().tick(now_s)
        frame, age_s = self.seen(now_s)
        if self.plots.due(now_s) and self.query_one("#trend").display:
            self.query_one("#trend", Trend).show(TrendView(self.points(), self.app.units.rate, age_s > STALE_S))
        if self.maps.due(now_s) and self.query_one("#right").display:
            place = frame.place_m if frame else None
            heading = frame.row.heading_deg if frame else None
            self.query_one("#map", FieldMap).show(MapView(self.spots(), place, heading, self.app.units.rate,
                                                          self.app.units.distance, age_s > STALE_S))

    def show_numbers(self, view: RunView) -> None:
        super().show_numbers(view)
        self.query_one("#rates", Rates).show(view.rates)
        self.query_one("#tiles", Tiles).show(view.tiles)
        self.query_one("#heads", Heads).show(view.heads)
        for items in self.query(Items):
            items.show(view.items)

    def points(self) -> tuple[Point, ...]:
        raise NotImplementedError

    def spots(self) -> tuple[Spot, ...]:
        raise NotImplementedError

"""What Run and Replay share: the panels and where they stand at each size."""
from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Vertical

from console.app.camera import Camera, fit
from console.app.layers import Layer
from console.app.pages.log_page import EMPTY_MAP, LogPage
from console.app.view import STALE_S, RunView, look
from console.app.widgets.field_map import FieldMap
from console.app.widgets.heads import Heads
from console.app.widgets.items import Items
from console.app.widgets.map_legend import MapLegend, legend_of
from console.app.widgets.map_title import MapTitle
from console.app.widgets.rates import Rates
from console.app.widgets.tiles import Tiles
from console.app.widgets.trend import Trend, TrendView
from console.frame import Frame
from console.locale import in_use

COARSEST_M = 3.0          # of a pixel: a larger field is not shown whole, the map follows the machine


class PanelScreen(LogPage):
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
            yield MapTitle((self.app.units.rate.name, in_use()), id="map-title")
            yield FieldMap(EMPTY_MAP, id="map")
            yield MapLegend(legend_of(EMPTY_MAP.scale, 1.0, self.app.units.distance, False), id="map-legend")
            yield Items(view.items, id="items-side")

    def tick(self, now_s: float) -> None:
        super().tick(now_s)
        frame, age_s = self.seen(now_s)
        if self.plots.due(now_s) and self.query_one("#trend").display:
            self.query_one("#trend", Trend).show(TrendView(self.points(), self.app.units.rate, age_s > STALE_S))
        if self.maps.due(now_s) and self.query_one("#right").display:
            self._show_map(frame, age_s)

    def _show_map(self, frame: Frame | None, age_s: float) -> None:
        units, field_map = self.app.units, self.query_one("#map", FieldMap)
        width, height = field_map.content_size
        camera = self._camera(frame, field_map.view.camera, width, 2 * height)
        view = self.map_view(frame, age_s, Layer.APPLIED, camera)
        field_map.show(view)
        self.query_one("#map-title", MapTitle).show((units.rate.name, in_use()))
        self.query_one("#map-legend", MapLegend).show(
            legend_of(view.scale, camera.metres, units.distance,
                      view.picture is not None and view.picture.planned is not None))

    def _camera(self, frame: Frame | None, before: Camera, columns: int, rows: int) -> Camera:
        """Everything at once where that can be read, else the ground round the machine."""
        whole = fit(self.whole(frame), columns, rows)
        if whole.metres <= COARSEST_M or frame is None or frame.place_m is None:
            return whole
        near = before if before.metres == COARSEST_M else Camera(*frame.place_m, COARSEST_M)
        return near.following(frame.place_m, columns, rows)

    def show_numbers(self, view: RunView) -> None:
        super().show_numbers(view)
        self.query_one("#rates", Rates).show(view.rates)
        self.query_one("#tiles", Tiles).show(view.tiles)
        self.query_one("#heads", Heads).show(view.heads)
        for items in self.query(Items):
            items.show(view.items)

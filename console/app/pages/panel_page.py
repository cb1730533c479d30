"""Defines the panels that Run and Replay share, and their positions at each screen size."""

from __future__ import annotations

from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.content import Content
from topdress.console.app.frame_history import TREND_SPAN_S, TrendPoint
from topdress.console.app.map_camera import MapCamera, fit_box
from topdress.console.app.map_layers import MapLayer
from topdress.console.app.pages.log_page import EMPTY_MAP, LogPage
from topdress.console.app.panel_views import (
    MAX_FRESH_AGE_S,
    RunView,
    format_duration,
    format_local_time,
    make_run_view,
)
from topdress.console.app.widgets.base_panel import Panel, make_line
from topdress.console.app.widgets.field_map import FieldMap
from topdress.console.app.widgets.labelled_values import Items
from topdress.console.app.widgets.map_legend import LegendView, MapLegend
from topdress.console.app.widgets.rate_panels import RatesPanel
from topdress.console.app.widgets.rate_trend import (
    CursorReading,
    Trend,
    TrendView,
    count_plot_columns,
)
from topdress.console.app.widgets.value_tiles import (
    GRAPH_CHANNELS,
    GraphsView,
    HeadsPanel,
    TileGraphs,
    TilesPanel,
    make_graph,
)
from topdress.console.frame import Frame
from topdress.console.locale import _


class MapTitle(Panel[str]):
    """Shows the quantity of the map with its unit."""

    def draw_rows(self, view: str, width: int, height: int) -> list[Content]:
        return [make_line((f" {_('map')} ", "bold"), (f"{_('applied')} {view}", "$muted"))]

    async def on_click(self, event: events.Click) -> None:
        """Open the Map page."""
        event.stop()
        await self.run_action("app.do('map_screen')")


# Largest pixel, m, at which a field is shown whole; in a larger field the map follows the machine.
MAX_PIXEL_M = 3.0
# A longer time without a row is a gap, s.
MAX_ROW_STEP_S = 2.5
# Period of a refresh without a new frame, s; a standing machine sends frames at the same period.
REDRAW_PERIOD_S = 0.5
# Points of the small graph below a tile.
MAX_GRAPH_POINTS = 60


class PanelScreen(LogPage):
    """Shows the panels. Trends are dropped below 36 rows, then the map below 100 columns.
    `cursor_s` is the time at which the trend is read, s of the run."""

    cursor_s: float | None = None

    def __init__(self) -> None:
        super().__init__()
        self._shown_frame: Frame | None = None

    def compose_body(self) -> ComposeResult:
        view = make_run_view(None, 0.0, self.app.units)
        with Vertical(id="left"):
            yield RatesPanel(view.rates, id="rates")
            yield TilesPanel(view.tiles, id="tiles")
            yield TileGraphs(GraphsView(()), id="tile-graphs")
            yield HeadsPanel(view.heads, id="heads")
            yield Items(view.items, id="items-low")
            yield Trend(TrendView((), self.app.units.rate), id="trend")
        with Vertical(id="right"):
            yield MapTitle(self.app.units.rate.name, id="map-title")
            yield FieldMap(EMPTY_MAP, id="map")
            yield MapLegend(
                LegendView(EMPTY_MAP.scale, 1.0, self.app.units.distance, False), id="map-legend"
            )
            yield Items(view.items, id="items-side")

    def show_due(self, now_s: float) -> None:
        """Show what is due. Between two frames hardly anything changes; all changes are drawn
        together, because each drawing costs time."""
        # The age of values changes without frames too, so a refresh follows after
        # `REDRAW_PERIOD_S`.
        frame, age_s = self.find_frame(now_s)
        looked_s, hurried = self.numbers.last_s, None in (self.plots.last_s, self.maps.last_s)
        soon = (
            looked_s is not None
            and 0.0 <= now_s - looked_s < REDRAW_PERIOD_S
            and age_s <= MAX_FRESH_AGE_S
        )
        if frame is self._shown_frame and soon and not hurried:
            return
        super().show_due(now_s)
        if self.numbers.last_s == now_s:
            self._shown_frame = frame
        if self.plots.is_due(now_s):
            self._show_trend(frame, age_s > MAX_FRESH_AGE_S)
        if self.maps.is_due(now_s) and self.query_one("#right").display:
            self._show_map(frame, age_s)

    # The following methods show the trend and read it at the cursor.

    def _show_trend(self, frame: Frame | None, stale: bool) -> None:
        """Show the trend and the small graphs below the tiles."""
        if self.query_one("#trend").display:
            points = self.list_trend_points()
            self.query_one("#trend", Trend).show_view(
                TrendView(points, self.app.units.rate, stale, read=self._read_cursor(points, frame))
            )
        graphs = self.query_one("#tile-graphs", TileGraphs)
        if graphs.display:
            series = self.find_series()
            end_s = frame.row.time_s if frame is not None else 0.0
            begin_s = end_s - TREND_SPAN_S
            drawn = (
                series.find_stretch(channel, begin_s, end_s, MAX_GRAPH_POINTS)
                for channel in GRAPH_CHANNELS
            )
            graphs.show_view(
                GraphsView(
                    tuple(
                        make_graph(one.time_s.tolist(), one.mean.tolist(), begin_s, TREND_SPAN_S)
                        for one in drawn
                    ),
                    stale,
                )
            )

    def _read_cursor(
        self, points: tuple[TrendPoint, ...], frame: Frame | None
    ) -> CursorReading | None:
        """Return the values at the cursor. The cursor is removed when its time leaves the trend."""
        if self.cursor_s is None or not points or frame is None:
            return None
        if not points[-1].time_s - TREND_SPAN_S <= self.cursor_s <= points[-1].time_s:
            self.cursor_s = None
            return None
        # The last point before the cursor was in force at that time, unless a gap lies between.
        before = [
            point
            for point in points
            if self.cursor_s - MAX_ROW_STEP_S <= point.time_s <= self.cursor_s
        ]
        target, applied = (
            (before[-1].target_kg_ha, before[-1].applied_kg_ha) if before else (None, None)
        )
        unit, back_s = self.app.units.rate, frame.row.time_s - self.cursor_s
        return CursorReading(
            self.cursor_s,
            format_local_time(frame.row.utc, self.app.utc_offset_s, back_s)
            or format_duration(self.cursor_s),
            unit.format_value(target),
            unit.format_value(applied),
        )

    def move_cursor(self, cells: int) -> None:
        """Move the cursor by cells of the trend; the first step sets it to the newest value."""
        points = self.list_trend_points()
        if points:
            end_s = points[-1].time_s
            cell_s = TREND_SPAN_S / max(
                1, count_plot_columns(self.query_one("#trend").content_size.width) - 1
            )
            at_s = end_s if self.cursor_s is None else self.cursor_s
            self._set_cursor(
                max(end_s - TREND_SPAN_S, points[0].time_s, min(end_s, at_s + cells * cell_s))
            )

    def drop_cursor(self) -> None:
        """Remove the cursor."""
        self._set_cursor(None)

    def explain_no_cursor(self) -> str:
        """Return why the trend cannot be read; "" where it can."""
        if not (self.is_mounted and self.query_one("#trend").display):
            return _("the trend is not shown: 36 rows or more show it; F4 shows it at any size")
        return "" if self.list_trend_points() else _("no values yet")

    def _set_cursor(self, time_s: float | None) -> None:
        """Set or remove the cursor and refresh the plots."""
        self.cursor_s = time_s
        self.plots.make_due()
        self.show_due(self.app.clock())

    def on_trend_pointed(self, event: Trend.Pointed) -> None:
        """Set the cursor at the clicked time."""
        points = self.list_trend_points()
        if points and not self.app.locked:
            self._set_cursor(points[-1].time_s - (1.0 - min(1.0, event.share)) * TREND_SPAN_S)

    def on_trend_left(self, event: Trend.Left) -> None:
        """Remove the cursor."""
        self.drop_cursor()

    # The following methods show the map.

    def _show_map(self, frame: Frame | None, age_s: float) -> None:
        """Show the map with its legend."""
        units, field_map = self.app.units, self.query_one("#map", FieldMap)
        width, height = field_map.content_size
        camera = self._choose_camera(frame, field_map.view.camera, width, 2 * height)
        view = self.make_map_view(frame, age_s, MapLayer.APPLIED, camera)
        field_map.show_view(view)
        self.query_one("#map-title", MapTitle).show_view(units.rate.name)
        self.query_one("#map-legend", MapLegend).show_view(
            LegendView(
                view.scale,
                camera.metres,
                units.distance,
                view.picture is not None and view.picture.planned is not None,
            )
        )

    def _choose_camera(
        self, frame: Frame | None, before: MapCamera, columns: int, rows: int
    ) -> MapCamera:
        """Return the camera of the whole field where its pixels are small enough, else of the
        ground around the machine."""
        whole = fit_box(self.find_whole_box(frame), columns, rows)
        if whole.metres <= MAX_PIXEL_M or frame is None or frame.place_m is None:
            return whole
        near = before if before.metres == MAX_PIXEL_M else MapCamera(*frame.place_m, MAX_PIXEL_M)
        return near.follow_place(frame.place_m, columns, rows)

    def show_numbers(self, view: RunView) -> None:
        """Show rates, tiles, heads and items."""
        super().show_numbers(view)
        self.query_one("#rates", RatesPanel).show_view(view.rates)
        self.query_one("#tiles", TilesPanel).show_view(view.tiles)
        self.query_one("#heads", HeadsPanel).show_view(view.heads)
        for items in self.query(Items):
            items.show_view(view.items)

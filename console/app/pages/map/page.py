"""Shows the Map screen: the field by applied rate, target, error or NDVI, with the plan and the
machine.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Vertical
from topdress.console.app.action import JOB, MAP, make_bindings
from topdress.console.app.boundary_drive import BoundaryDrive
from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.guide_line import MIN_LINE_LENGTH_M
from topdress.console.app.guide_line_store import (
    make_corner_record,
    make_drive_record,
    make_line_record,
)
from topdress.console.app.map_camera import MapCamera, fit_box
from topdress.console.app.map_layers import LAYER_LABELS, MapLayer
from topdress.console.app.overlay_file import OverlayFile, OverlayView
from topdress.console.app.pages.log_page import EMPTY_MAP, LogPage
from topdress.console.app.pages.map.keys import ACTIONS
from topdress.console.app.pages.map.map_pane import MapBar, MapBarView, MapPane, Place, ReadingLine
from topdress.console.app.pages.map.overlay_legend import (
    OverlayLegend,
    OverlayLegendView,
    OverlayLoader,
    find_overlay_label,
)
from topdress.console.app.pages.map.place_reading import (
    PlaceReading,
    list_job_items,
    make_place_reading,
)
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.panel_views import MAX_FRESH_AGE_S, RunView, make_run_view
from topdress.console.app.widgets.labelled_values import Items
from topdress.console.app.widgets.map_legend import LegendView, MapLegend
from topdress.console.app.widgets.rate_panels import SeatRates
from topdress.console.frame import Frame
from topdress.console.locale import _

# Share of the picture by which an arrow key moves the map.
PAN_PICTURE_SHARE = 0.2
# Size of a pixel, m, when following starts from the picture of the whole field.
FOLLOW_PIXEL_M = 0.5


class MapScreen(LogPage):
    """Shows the map. A camera of None shows the whole field while it grows. A position is marked
    where keys have moved the map."""

    where: ClassVar[str] = MAP
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.shown_layer, self.follow, self.plan = MapLayer.APPLIED, True, True
        self.camera: MapCamera | None = None
        self.pointed: Place | None = None
        self.marked = False
        self.laid = OverlayLoader(self)
        self._frame: Frame | None = None
        self.drive: BoundaryDrive | None = None
        # Way of the boundary drive for the map; east and north, m.
        self._driven: list[Place] = []

    def compose_body(self) -> ComposeResult:
        # Before the first frame the panels show "--".
        rates = make_run_view(None, 0.0, self.app.units).rates
        with Vertical(id="map-left"):
            yield SeatRates(rates, id="map-strip")
            yield MapBar(MapBarView(self.shown_layer, ()), id="map-bar")
            yield MapPane(EMPTY_MAP, id="map-pane")
            yield MapLegend(
                LegendView(EMPTY_MAP.scale, 1.0, self.app.units.distance, False), id="map-scale"
            )
            yield OverlayLegend(OverlayLegendView("", "", None, ""), id="map-laid")
            yield ReadingLine(PlaceReading("", ()), id="map-reading")
        with Vertical(id="map-right"):
            yield SeatRates(rates, id="map-rates")
            yield Items((), id="map-job")

    def find_replayed(self) -> ReplayJob | None:
        return self.app.replay_page.job if self.app.source is None or self.wants_log else None

    def show_due(self, now_s: float) -> None:
        super().show_due(now_s)
        # Drawing a map is the slowest part of a refresh, so it has its own period.
        if self.maps.is_due(now_s):
            self._frame, age_s = self.find_frame(now_s)
            self._draw_map(age_s)

    def show_numbers(self, view: RunView) -> None:
        """Show rates and totals."""
        super().show_numbers(view)
        for rates in self.query(SeatRates):
            rates.show_view(view.rates)
        frame, age_s = self.find_frame(self.app.clock())
        self.query_one("#map-job", Items).show_view(
            list_job_items(
                frame, self.app.fields.find_picture(frame), self.app.units, age_s > MAX_FRESH_AGE_S
            )
        )

    # The following methods record a boundary and set the A-B line.

    def gather_frame(self, frame: Frame) -> None:
        super().gather_frame(frame)
        if self.drive is not None:
            # A new corner is stored at once, because a console may die at any time.
            before = len(self.drive.corners)
            self.drive.add_row(frame.row)
            if frame.place_m is not None and len(self.drive.corners) > before:
                self._driven.append(frame.place_m)
                self.app.keep_line_record(
                    make_corner_record(self.drive.corners[-1], frame.place_m, frame.row.time_s)
                )

    def _set_drive(self, drive: BoundaryDrive | None) -> None:
        """Begin a boundary drive, or end it with None."""
        frame = self.app.arrival.frame
        self.drive, self._driven = drive, []
        self.app.keep_line_record(
            make_drive_record(drive, frame.row.time_s if frame is not None else 0.0)
        )

    def resume_drive(self, drive: BoundaryDrive, way: tuple[Place, ...]) -> None:
        """Continue a boundary drive that another console began."""
        self.drive, self._driven = drive, list(way)
        self.app.show_notice(
            _("the boundary goes on: {way} driven so far").format(
                way=self.app.units.distance.format_with_name(drive.way_m)
            )
        )
        self.refresh_all_next_tick()

    def press_boundary_key(self) -> None:
        """Begin a boundary drive, or end it."""
        picture = self.app.fields.find_picture(self.app.arrival.frame)
        if self.drive is not None:
            self._end_drive(self.drive)
            return
        # The antenna is in the middle of the machine, so the edge lies half a working width aside.
        half_m = 0.5 * (picture.width_m if picture is not None else 0.0)
        distance = self.app.units.fine_distance

        def begin_drive(side: str) -> None:
            # The side determines the sign of the offset from the antenna.
            self._set_drive(BoundaryDrive({"left": -half_m, "right": half_m}.get(side, 0.0)))
            self.app.show_notice(_("the boundary begins here: drive round the field, then B again"))
            self.app.show_changes()

        self.app.ask_question(
            ChoiceDialog(
                _("Drive round the field. Where is its edge?"),
                [
                    Choice(
                        "right",
                        _("to the right, half a width ({half}): driven clockwise").format(
                            half=distance.format_with_name(half_m)
                        ),
                    ),
                    Choice(
                        "left",
                        _("to the left, half a width ({half}): driven anticlockwise").format(
                            half=distance.format_with_name(half_m)
                        ),
                    ),
                    Choice("middle", _("under the middle of the machine")),
                ],
                "",
            ),
            begin_drive,
        )

    def _end_drive(self, drive: BoundaryDrive) -> None:
        """End the boundary drive after a question."""
        way, units = self.app.units.distance.format_with_name(drive.way_m), self.app.units

        def drop_drive() -> None:
            self._set_drive(None)
            self.app.show_changes()

        # A way that is too short or open can only be cancelled.
        if not drive.is_closable:
            self.app.ask_yes_no(
                _("Cancel the boundary?"),
                _(
                    "{way} driven, {open} from the end back to its beginning: that is no "
                    "field yet. Esc goes on."
                ).format(way=way, open=units.distance.format_with_name(drive.closing_gap_m)),
                drop_drive,
            )
            return

        def take_choice(answer: str) -> None:
            service = self.app.services.job
            if answer == "drop":
                drop_drive()
            elif answer == "keep" and service is not None:
                # The ring is made before the drive is removed.
                ring = drive.make_edge_ring_deg()
                self._set_drive(None)
                self.app.turn_to_page(JOB)
                # The Job page asks for the restart, so it must be open first.
                self.call_later(
                    self.app.job_page.choose_written_file,
                    lambda: service.save_driven_boundary(ring),
                )

        # The boundary becomes part of the job file, which needs a restart of the worker.
        no_files = (
            _("files are not available here")
            if self.app.services.job is None
            else (
                _("stop the machine first (X); the boundary waits")
                if self.app.job_page.is_at_work
                else ""
            )
        )
        self.app.ask_question(
            ChoiceDialog(
                _("The boundary ends here"),
                [
                    Choice("keep", _("keep it as the job's field"), no_files),
                    Choice("more", _("go on driving")),
                    Choice("drop", _("cancel it")),
                ],
                "",
                _("{way} driven; the last {open} back to its beginning are drawn straight.").format(
                    way=way, open=units.distance.format_with_name(drive.closing_gap_m)
                ),
            ),
            take_choice,
        )

    def press_guide_key(self) -> None:
        """Set A, then B; a third press begins with a new A."""
        frame, guide = self.app.arrival.frame, self.app.guide
        picture = self.app.fields.find_picture(frame)
        if frame is None or frame.place_m is None or picture is None:
            self.app.show_notice(_("no position yet"))
        # A complete line is replaced by a new one.
        elif guide.a is None or guide.b is not None:
            guide.set_begin(frame.place_m, picture.width_m)
            self.app.keep_line_record(make_line_record(guide))
            self.app.show_notice(_("A is here: drive along the line, then N sets B"))
        elif guide.set_end(frame.place_m):
            self.app.keep_line_record(make_line_record(guide))
            self.app.show_notice(
                _("the A-B line is set: the Run page shows how far the machine is off it")
            )
        else:
            self.app.show_notice(
                _("B is too near to A: {least} or more are needed").format(
                    least=self.app.units.distance.format_with_name(MIN_LINE_LENGTH_M)
                )
            )

    # The following methods draw the map.

    @property
    def pane(self) -> MapPane:
        """Widget of the map."""
        return self.query_one("#map-pane", MapPane)

    def _find_map_size(self) -> tuple[int, int]:
        """Return the size of the map in pixels."""
        width, height = self.pane.content_size
        return width, 2 * height

    def _find_camera(self) -> MapCamera:
        """Return the present camera; following moves it with the machine."""
        frame = self._frame
        if self.camera is None:
            # Without a camera the whole field is fitted anew for each picture.
            return fit_box(self.find_whole_box(frame), *self._find_map_size())
        if self.follow and frame is not None and frame.place_m is not None:
            self.camera = self.camera.follow_place(frame.place_m, *self._find_map_size())
        return self.camera

    def _draw_map(self, age_s: float) -> None:
        """Draw map, bar, legend and reading."""
        frame, units = self._frame, self.app.units
        camera = self._find_camera()
        cross = (camera.east_m, camera.north_m) if self.marked else None
        laid = self.laid.find_overlay(frame)
        view = self.make_map_view(frame, age_s, self.shown_layer, camera, laid)._replace(
            plan=self.plan, cross=cross
        )
        if self.driven_boundary:
            view = view._replace(lines=(*view.lines, self.driven_boundary))
        self.pane.show_view(view)
        planned = self.plan and view.picture is not None and view.picture.planned is not None
        self.query_one("#map-scale", MapLegend).show_view(
            LegendView(view.scale, camera.metres, units.distance, planned)
        )
        self.query_one("#map-bar", MapBar).show_view(
            MapBarView(self.shown_layer, self._list_states())
        )
        self._show_legend(laid, view.laid)
        self._show_reading(camera)

    def _show_legend(self, laid: OverlayFile | None, shown: OverlayView | None) -> None:
        """Show the legend of the overlaid file, or why there is none."""
        legend = self.query_one("#map-laid", OverlayLegend)
        legend.display = bool(self.laid.path)
        if laid is None:
            # The overlay needs a position to find the plane of the field.
            waits = self._frame is None or self._frame.place_m is None
            said = _("no position yet") if waits else _("reading the file")
            legend.show_view(OverlayLegendView(Path(self.laid.path).name, "", None, said))
            return
        scale = shown.scale if shown is not None else None
        label = find_overlay_label(scale, laid.harvest.label if laid.harvest is not None else "")
        lacks = _("no {what} in it").format(what=_(LAYER_LABELS[self.shown_layer]))
        legend.show_view(
            OverlayLegendView(laid.name, label, scale, "" if scale is not None else lacks)
        )

    def overlay_file(self, path: str) -> None:
        """Overlay a file on the map; "" removes the overlay."""
        self.laid.request_file(path)
        self.app.show_changes()

    @property
    def driven_boundary(self) -> tuple[tuple[float, float], ...]:
        """Boundary in progress for the map."""
        return tuple(self._driven) if self.drive is not None else ()

    def _list_states(self) -> tuple[str, ...]:
        """Return the states of the map in words: log, boundary, whole field, following."""
        log: tuple[str, ...] = (_("log"),) if self.find_replayed() is not None else ()
        if self.drive is not None:
            log = (
                _("BOUNDARY {way}").format(
                    way=self.app.units.distance.format_with_name(self.drive.way_m)
                ),
                *log,
            )
        if self.camera is None:
            return (*log, _("whole field"))
        return (*log, _("following") if self.follow else _("standing"))

    def _show_reading(self, camera: MapCamera) -> None:
        """Show the reading under the pointer, at the mark, or under the machine."""
        frame = self._frame
        worked, picture = self.find_ground(frame)
        where: str
        place: Place | None
        if self.pointed is not None:
            where, place = _("pointer"), self.pointed
        elif self.marked:
            where, place = _("mark +"), (camera.east_m, camera.north_m)
        else:
            where, place = _("under machine"), frame.place_m if frame is not None else None
        self.query_one("#map-reading", ReadingLine).show_view(
            make_place_reading(
                where,
                place,
                max(worked.cells_m[0], camera.metres),
                worked,
                picture,
                self.app.units,
                self.pane.view.laid,
            )
        )

    # The following methods react to keys, clicks and drags.

    def zoom_map(self, steps: int) -> None:
        """Zoom by steps."""
        self.camera = self._find_camera().zoom_steps(steps)

    def pan_map(self, right: int, up: int) -> None:
        """Move the map by a share of the picture, and mark its middle."""
        width, height = self._find_map_size()
        self._move_camera(
            round(right * PAN_PICTURE_SHARE * width), round(up * PAN_PICTURE_SHARE * height)
        )
        self.marked = True

    def toggle_follow(self) -> None:
        """Follow the machine, or stop following."""
        self.follow = self.camera is None or not self.follow
        self.marked = False
        # Following needs a position of the machine.
        place = self._frame.place_m if self._frame is not None else None
        if self.camera is None and place is not None:
            self.camera = MapCamera(*place, min(FOLLOW_PIXEL_M, self._find_camera().metres))

    def _move_camera(self, columns: int, rows: int) -> None:
        """Move the map by pixels, which ends following."""
        self.camera, self.follow = self._find_camera().move_pixels(columns, rows), False

    def on_resize(self, event: object) -> None:
        """Draw the map for the new size."""
        self.maps.make_due()

    def on_map_bar_chosen(self, event: MapBar.Chosen) -> None:
        """Show the chosen layer."""
        if not self.app.locked:
            self.shown_layer = event.layer
            self.app.show_changes()

    def on_map_pane_pointed(self, event: MapPane.Pointed) -> None:
        """Show the reading under the pointer."""
        self.pointed = event.place
        self._show_reading(self._find_camera())

    def on_map_pane_dragged(self, event: MapPane.Dragged) -> None:
        """Move the map with the pointer."""
        if not self.app.locked:
            self._move_camera(-event.columns, event.rows)
            self.marked = False
            self.app.show_changes()

    def on_map_pane_wheeled(self, event: MapPane.Wheeled) -> None:
        """Zoom at the pointer."""
        if self.app.locked:
            return
        before = self._find_camera()
        near = before.zoom_steps(event.steps)
        # The position under the pointer stays in place: its distance from the middle shrinks with
        # the pixel size.
        share = near.metres / before.metres
        east, north = event.place
        self.camera = near._replace(
            east_m=east + share * (before.east_m - east),
            north_m=north + share * (before.north_m - north),
        )
        self.app.show_changes()

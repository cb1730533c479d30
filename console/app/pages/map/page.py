"""The Map screen: the field by what was applied, wanted, missed or sensed, the plan under it,
and the machine on it."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Vertical
from topdress.console.app.action import JOB, MAP, make_bindings
from topdress.console.app.boundary_drive import BoundaryDrive
from topdress.console.app.camera import MapCamera, fit
from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.guide_line import LEAST_M
from topdress.console.app.guide_line_store import corner_record, make_drive_record, make_line_record
from topdress.console.app.layers import LABELS, MapLayer
from topdress.console.app.overlay_file import LaidFile, LaidView
from topdress.console.app.pages.log_page import EMPTY_MAP, LogPage
from topdress.console.app.pages.map.keys import ACTIONS
from topdress.console.app.pages.map.laid_legend import (
    LaidFiles,
    LaidLegend,
    LaidLegendView,
    label_of,
)
from topdress.console.app.pages.map.map_pane import MapBar, MapBarView, MapPane, Place, ReadingLine
from topdress.console.app.pages.map.reading import PlaceReading, list_job_items, reading
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.view import STALE_S, RunView, look
from topdress.console.app.widgets.items import Items
from topdress.console.app.widgets.map_legend import LegendView, MapLegend
from topdress.console.app.widgets.rates import SeatRates
from topdress.console.frame import Frame
from topdress.console.locale import _

PAN_SHARE = 0.2  # of the picture's width, by an arrow key
# of a pixel, when the machine is followed from the whole field's picture
NEAR_M = 0.5


class MapScreen(LogPage):
    """camera None: the whole field, however it grows. A place is marked where the map was moved
    to by keys."""

    where: ClassVar[str] = MAP
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.shown_layer, self.follow, self.plan = MapLayer.APPLIED, True, True
        self.camera: MapCamera | None = None
        self.pointed: Place | None = None
        self.marked = False
        self.laid = LaidFiles(self)
        self._frame: Frame | None = None
        self.drive: BoundaryDrive | None = None
        self._driven: list[Place] = []  # of the drive, as the map draws it

    def body(self) -> ComposeResult:
        rates = look(None, 0.0, self.app.units).rates
        with Vertical(id="map-left"):
            yield SeatRates(rates, id="map-strip")
            yield MapBar(MapBarView(self.shown_layer, ()), id="map-bar")
            yield MapPane(EMPTY_MAP, id="map-pane")
            yield MapLegend(
                LegendView(EMPTY_MAP.scale, 1.0, self.app.units.distance, False), id="map-scale"
            )
            yield LaidLegend(LaidLegendView("", "", None, ""), id="map-laid")
            yield ReadingLine(PlaceReading("", ()), id="map-reading")
        with Vertical(id="map-right"):
            yield SeatRates(rates, id="map-rates")
            yield Items((), id="map-job")

    def replayed(self) -> ReplayJob | None:
        return self.app.replay_page.job if self.app.source is None or self.wants_log else None

    def tick(self, now_s: float) -> None:
        super().tick(now_s)
        if self.maps.due(now_s):
            self._frame, age_s = self.seen(now_s)
            self._draw(age_s)

    def show_numbers(self, view: RunView) -> None:
        super().show_numbers(view)
        for rates in self.query(SeatRates):
            rates.show(view.rates)
        frame, age_s = self.seen(self.app.clock())
        self.query_one("#map-job", Items).show(
            list_job_items(frame, self.app.fields.of(frame), self.app.units, age_s > STALE_S)
        )

    # --- a boundary by driving round it, and the A-B line
    # ----------------------------------------------------------

    def gather(self, frame: Frame) -> None:
        super().gather(frame)
        if self.drive is not None:
            before = len(self.drive.corners)
            self.drive.add(frame.row)
            if frame.place_m is not None and len(self.drive.corners) > before:
                self._driven.append(frame.place_m)
                self.app.keep_line(
                    corner_record(self.drive.corners[-1], frame.place_m, frame.row.time_s)
                )

    def _drive_is(self, drive: BoundaryDrive | None) -> None:
        """One begins, or the one that there was has ended."""
        frame = self.app.arrival.frame
        self.drive, self._driven = drive, []
        self.app.keep_line(make_drive_record(drive, frame.row.time_s if frame is not None else 0.0))

    def go_on_driving(self, drive: BoundaryDrive, way: tuple[Place, ...]) -> None:
        """One that another console began."""
        self.drive, self._driven = drive, list(way)
        self.app.notice(
            _("the boundary goes on: {way} driven so far").format(
                way=self.app.units.distance.full(drive.way_m)
            )
        )
        self.hurry()

    def boundary_key(self) -> None:
        """Begins the drive, or ends it."""
        picture = self.app.fields.of(self.app.arrival.frame)
        if self.drive is not None:
            self._end_drive(self.drive)
            return
        half_m = 0.5 * (picture.width_m if picture is not None else 0.0)
        distance = self.app.units.fine_distance

        def begin(side: str) -> None:
            self._drive_is(BoundaryDrive({"left": -half_m, "right": half_m}.get(side, 0.0)))
            self.app.notice(_("the boundary begins here: drive round the field, then B again"))
            self.app.look()

        self.app.ask(
            ChoiceDialog(
                _("Drive round the field. Where is its edge?"),
                [
                    Choice(
                        "right",
                        _("to the right, half a width ({half}): driven clockwise").format(
                            half=distance.full(half_m)
                        ),
                    ),
                    Choice(
                        "left",
                        _("to the left, half a width ({half}): driven anticlockwise").format(
                            half=distance.full(half_m)
                        ),
                    ),
                    Choice("middle", _("under the middle of the machine")),
                ],
                "",
            ),
            begin,
        )

    def _end_drive(self, drive: BoundaryDrive) -> None:
        way, units = self.app.units.distance.full(drive.way_m), self.app.units

        def drop() -> None:
            self._drive_is(None)
            self.app.look()

        if not drive.enough:
            self.app.confirm(
                _("Cancel the boundary?"),
                _(
                    "{way} driven, {open} from the end back to its beginning: that is no "
                    "field yet. Esc goes on."
                ).format(way=way, open=units.distance.full(drive.open_m)),
                drop,
            )
            return

        def keep(answer: str) -> None:
            service = self.app.services.job
            if answer == "drop":
                drop()
            elif answer == "keep" and service is not None:
                ring = drive.ring_deg()
                self._drive_is(None)
                self.app.turn_to(JOB)
                self.call_later(self.app.job_page.take, lambda: service.save_driven_boundary(ring))

        no_files = (
            _("files are not available here")
            if self.app.services.job is None
            else (
                _("stop the machine first (X); the boundary waits")
                if self.app.job_page.at_work
                else ""
            )
        )
        self.app.ask(
            ChoiceDialog(
                _("The boundary ends here"),
                [
                    Choice("keep", _("keep it as the job's field"), no_files),
                    Choice("more", _("go on driving")),
                    Choice("drop", _("cancel it")),
                ],
                "",
                _("{way} driven; the last {open} back to its beginning are drawn straight.").format(
                    way=way, open=units.distance.full(drive.open_m)
                ),
            ),
            keep,
        )

    def guide_key(self) -> None:
        """Sets A, then B; a third time it begins anew."""
        frame, guide = self.app.arrival.frame, self.app.guide
        picture = self.app.fields.of(frame)
        if frame is None or frame.place_m is None or picture is None:
            self.app.notice(_("no position yet"))
        elif guide.a is None or guide.b is not None:
            guide.begin(frame.place_m, picture.width_m)
            self.app.keep_line(make_line_record(guide))
            self.app.notice(_("A is here: drive along the line, then N sets B"))
        elif guide.end(frame.place_m):
            self.app.keep_line(make_line_record(guide))
            self.app.notice(
                _("the A-B line is set: the Run page shows how far the machine is off it")
            )
        else:
            self.app.notice(
                _("B is too near to A: {least} or more are needed").format(
                    least=self.app.units.distance.full(LEAST_M)
                )
            )

    # --- drawing
    # ----------------------------------------------------------------------------------------------

    @property
    def pane(self) -> MapPane:
        return self.query_one("#map-pane", MapPane)

    def _map_pixels(self) -> tuple[int, int]:
        width, height = self.pane.content_size
        return width, 2 * height

    def _camera(self) -> MapCamera:
        """Where the map looks now."""
        frame = self._frame
        if self.camera is None:
            return fit(self.whole(frame), *self._map_pixels())
        if self.follow and frame is not None and frame.place_m is not None:
            self.camera = self.camera.following(frame.place_m, *self._map_pixels())
        return self.camera

    def _draw(self, age_s: float) -> None:
        frame, units = self._frame, self.app.units
        camera = self._camera()
        cross = (camera.east_m, camera.north_m) if self.marked else None
        laid = self.laid.of(frame)
        view = self.map_view(frame, age_s, self.shown_layer, camera, laid)._replace(
            plan=self.plan, cross=cross
        )
        if self.driven:
            view = view._replace(lines=(*view.lines, self.driven))
        self.pane.show(view)
        planned = self.plan and view.picture is not None and view.picture.planned is not None
        self.query_one("#map-scale", MapLegend).show(
            LegendView(view.scale, camera.metres, units.distance, planned)
        )
        self.query_one("#map-bar", MapBar).show(MapBarView(self.shown_layer, self._states()))
        self._tell_laid(laid, view.laid)
        self._read(camera)

    def _tell_laid(self, laid: LaidFile | None, shown: LaidView | None) -> None:
        legend = self.query_one("#map-laid", LaidLegend)
        legend.display = bool(self.laid.path)
        if laid is None:
            waits = self._frame is None or self._frame.place_m is None
            said = _("no position yet") if waits else _("reading the file")
            legend.show(LaidLegendView(Path(self.laid.path).name, "", None, said))
            return
        scale = shown.scale if shown is not None else None
        label = label_of(scale, laid.harvest.label if laid.harvest is not None else "")
        lacks = _("no {what} in it").format(what=_(LABELS[self.shown_layer]))
        legend.show(LaidLegendView(laid.name, label, scale, "" if scale is not None else lacks))

    def lay(self, path: str) -> None:
        """ "": none."""
        self.laid.want(path)
        self.app.look()

    @property
    def driven(self) -> tuple[tuple[float, float], ...]:
        """The boundary so far, as the map draws it."""
        return tuple(self._driven) if self.drive is not None else ()

    def _states(self) -> tuple[str, ...]:
        log: tuple[str, ...] = (_("log"),) if self.replayed() is not None else ()
        if self.drive is not None:
            log = (
                _("BOUNDARY {way}").format(way=self.app.units.distance.full(self.drive.way_m)),
                *log,
            )
        if self.camera is None:
            return (*log, _("whole field"))
        return (*log, _("following") if self.follow else _("standing"))

    def _read(self, camera: MapCamera) -> None:
        frame = self._frame
        worked, picture = self.ground(frame)
        where: str
        place: Place | None
        if self.pointed is not None:
            where, place = _("pointer"), self.pointed
        elif self.marked:
            where, place = _("mark +"), (camera.east_m, camera.north_m)
        else:
            where, place = _("under machine"), frame.place_m if frame is not None else None
        self.query_one("#map-reading", ReadingLine).show(
            reading(
                where,
                place,
                max(worked.cells_m[0], camera.metres),
                worked,
                picture,
                self.app.units,
                self.pane.view.laid,
            )
        )

    # --- what is pressed, clicked, pulled
    # -----------------------------------------------------------------------

    def zoom(self, steps: int) -> None:
        self.camera = self._camera().zoomed(steps)

    def pan(self, right: int, up: int) -> None:
        """By a share of the picture; the middle is marked."""
        width, height = self._map_pixels()
        self._move(round(right * PAN_SHARE * width), round(up * PAN_SHARE * height))
        self.marked = True

    def toggle_follow(self) -> None:
        self.follow = self.camera is None or not self.follow
        self.marked = False
        place = self._frame.place_m if self._frame is not None else None
        if self.camera is None and place is not None:
            self.camera = MapCamera(*place, min(NEAR_M, self._camera().metres))

    def _move(self, columns: int, rows: int) -> None:
        self.camera, self.follow = self._camera().moved(columns, rows), False

    def on_resize(self, event: object) -> None:
        self.maps.hurry()

    def on_map_bar_chosen(self, event: MapBar.Chosen) -> None:
        if not self.app.locked:
            self.shown_layer = event.layer
            self.app.look()

    def on_map_pane_pointed(self, event: MapPane.Pointed) -> None:
        self.pointed = event.place
        self._read(self._camera())

    def on_map_pane_dragged(self, event: MapPane.Dragged) -> None:
        if not self.app.locked:
            self._move(-event.columns, event.rows)
            self.marked = False
            self.app.look()

    def on_map_pane_wheeled(self, event: MapPane.Wheeled) -> None:
        if self.app.locked:
            return
        before = self._camera()
        near = before.zoomed(event.steps)
        share = near.metres / before.metres
        east, north = event.place
        self.camera = near._replace(
            east_m=east + share * (before.east_m - east),
            north_m=north + share * (before.north_m - north),
        )
        self.app.look()

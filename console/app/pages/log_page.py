"""A page that shows the machine at work, or a log in its place."""

from __future__ import annotations

from topdress.console.app import words
from topdress.console.app.camera import MapCamera, around
from topdress.console.app.coverage_raster import Box, Worked
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.history import TREND_SPAN_S, LogHistory, Point, sample_points
from topdress.console.app.layers import LayerScale, MapLayer, find_colour_scale
from topdress.console.app.map_ink import MapView
from topdress.console.app.overlay_file import LaidFile, LaidView
from topdress.console.app.pages.page import Page
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.series import TrendSeries
from topdress.console.app.view import STALE_S, RunView, alarms
from topdress.console.frame import Frame
from topdress.console.locale import _

EMPTY_GROUND = Worked()
EMPTY_SCALE = LayerScale(MapLayer.APPLIED, 0.0, 100.0, 1.0, 0, "")
EMPTY_MAP = MapView(EMPTY_GROUND, 0, None, EMPTY_SCALE, MapCamera(0.0, 0.0, 1.0), None, None)


class LogPage(Page):
    """Alarms of a machine that works meanwhile come before the log's, and are said to be its
    own."""

    # a log in the machine's place, where both can be shown
    wants_log = False

    def replayed(self) -> ReplayJob | None:
        """The log to show; None: the machine."""
        return None

    def why_no_turn(self) -> str:
        """Why only the machine, or only a log, can be shown."""
        if self.app.replay_page.job is None:
            return _("no log is open: F7, J opens one")
        return _("no machine is connected") if self.app.source is None else ""

    def turn_log(self) -> None:
        """From the machine to the log of the replay, or back."""
        self.wants_log = not self.wants_log
        self.numbers.hurry()

    def log_history(self) -> LogHistory:
        return self.app.replay_page.history()

    def seen(self, now_s: float) -> tuple[Frame | None, float]:
        job = self.replayed()
        return super().seen(now_s) if job is None else (job.source.newest, job.source.age_s)

    def seen_view(self, frame: Frame | None, age_s: float) -> RunView:
        view = super().seen_view(frame, age_s)
        live = self.app.arrival.frame
        if self.replayed() is None and (frame is not None or live is None):
            return view
        view = view._replace(status=view.status._replace(lead=_("REPLAY")))
        if live is not None and live.alarms:
            shown = alarms(live, self.app.utc_offset_s, self.app.units)
            lines = tuple(
                line._replace(place=f"{_('MACHINE')} {line.place}") for line in shown.lines
            )
            return view._replace(alarms=shown._replace(lines=lines))
        return view

    def marks(self) -> tuple[str, ...]:
        """With the machine's state wherever the page shows something else, or nothing."""
        live = self.app.arrival.frame
        other = live is not None and self.seen(self.app.clock())[0] is not live
        if live is None or not other:
            return super().marks()
        return (
            f"{_('MACHINE')}: {words.name_state(live.row.state, live.why_state)}",
            *super().marks(),
        )

    def points(self) -> tuple[Point, ...]:
        """Of the trend of target and applied rate."""
        job = self.replayed()
        if job is None:
            return self.app.history.recent()
        source = job.source
        return sample_points(
            source.frames, source.first_index(source.at_s - TREND_SPAN_S), source.index
        )

    def series(self) -> TrendSeries:
        return self.app.history.series if self.replayed() is None else self.log_history().series

    def worked(self) -> Worked:
        """The worked ground so far. Of a log that is far ahead it is entered over some looks."""
        job = self.replayed()
        if job is None:
            return self.app.history.worked
        history = self.log_history()
        if not history.work_up_to(job.source.index):
            self.maps.hurry()
        return history.worked

    def ground(self, frame: Frame | None) -> tuple[Worked, FieldPicture | None]:
        """Worked ground and field, the outlets' width taken over from the field's machine."""
        picture, worked = self.app.fields.of(frame), self.worked()
        if picture is not None:
            worked.width_m, worked.sections = picture.width_m, picture.sections
        return worked, picture

    def map_view(
        self,
        frame: Frame | None,
        age_s: float,
        layer: MapLayer,
        camera: MapCamera,
        laid: LaidFile | None = None,
    ) -> MapView:
        """What a map shows of a frame, and of a file that is laid on it."""
        worked, picture = self.ground(frame)
        most_kg_ha = self.app.crop_limits_kg_ha[1] if self.replayed() is None else None
        scale = find_colour_scale(
            layer,
            worked,
            picture,
            self.app.units,
            laid.rate_ends if laid is not None else None,
            most_kg_ha,
        )
        by = laid.scale(scale) if laid is not None else None
        return MapView(
            worked,
            worked.version,
            picture,
            scale,
            camera,
            frame.place_m if frame else None,
            frame.row.heading_deg if frame else None,
            stale=age_s > STALE_S,
            lines=self.app.guide.drawn(camera),
            laid=LaidView(laid.worked, by) if laid is not None and by is not None else None,
        )

    def whole(self, frame: Frame | None) -> Box | None:
        """What a map of everything holds: field, worked ground, machine."""
        worked, picture = self.ground(frame)
        place = (
            Box(*frame.place_m, *frame.place_m)
            if frame is not None and frame.place_m is not None
            else None
        )
        return around(picture.box if picture is not None else None, worked.box, place)

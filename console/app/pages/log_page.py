"""Shows the machine at work, or a log in its place; Run, Map and Trends share this base class."""

from __future__ import annotations

from topdress.console.app import frame_words
from topdress.console.app.coverage_raster import GroundBox, WorkedGround
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.frame_history import TREND_SPAN_S, LogHistory, TrendPoint, sample_points
from topdress.console.app.map_camera import MapCamera, unite_boxes
from topdress.console.app.map_ink import MapView
from topdress.console.app.map_layers import LayerScale, MapLayer, find_colour_scale
from topdress.console.app.overlay_file import OverlayFile, OverlayView
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.panel_views import MAX_FRESH_AGE_S, RunView, make_alarms_view
from topdress.console.app.trend_series import TrendSeries
from topdress.console.frame import Frame
from topdress.console.locale import _

# Contents of a map before the first frame.
EMPTY_GROUND = WorkedGround()
EMPTY_SCALE = LayerScale(MapLayer.APPLIED, 0.0, 100.0, 1.0, 0, "")
EMPTY_MAP = MapView(EMPTY_GROUND, 0, None, EMPTY_SCALE, MapCamera(0.0, 0.0, 1.0), None, None)


class LogPage(Page):
    """Shows a machine or a log. Alarms of a working machine precede those of the log and are marked
    as the machine's."""

    # True if a page that can show both shows the log.
    wants_log = False

    def find_replayed(self) -> ReplayJob | None:
        """Return the log to show, or None for the machine."""
        return None

    def explain_no_turn(self) -> str:
        """Return why only the machine, or only a log, can be shown."""
        if self.app.replay_page.job is None:
            return _("no log is open: F7, J opens one")
        return _("no machine is connected") if self.app.source is None else ""

    def toggle_log(self) -> None:
        """Switch between the machine and the replayed log."""
        # The choice is per page, so that two pages can show different things.
        self.wants_log = not self.wants_log
        self.numbers.make_due()

    def find_log_history(self) -> LogHistory:
        """Return the history of the replayed log."""
        return self.app.replay_page.find_history()

    def find_frame(self, now_s: float) -> tuple[Frame | None, float]:
        job = self.find_replayed()
        return (
            super().find_frame(now_s)
            if job is None
            else (job.source.current_frame, job.source.frame_age_s)
        )

    def make_view(self, frame: Frame | None, age_s: float) -> RunView:
        view = super().make_view(frame, age_s)
        live = self.app.arrival.frame
        # The machine itself is shown.
        if self.find_replayed() is None and (frame is not None or live is None):
            return view
        view = view._replace(status=view.status._replace(lead=_("REPLAY")))
        if live is not None and live.alarms:
            # An alarm of the machine must stay visible while the operator reads an old log.
            shown = make_alarms_view(live, self.app.utc_offset_s, self.app.units)
            lines = tuple(
                line._replace(place=f"{_('MACHINE')} {line.place}") for line in shown.lines
            )
            return view._replace(alarms=shown._replace(lines=lines))
        return view

    def list_status_marks(self) -> tuple[str, ...]:
        """Return the marks of the status line, with the machine's state while the page shows
        something else."""
        live = self.app.arrival.frame
        # The state of the machine must be visible on every page.
        other = live is not None and self.find_frame(self.app.clock())[0] is not live
        if live is None or not other:
            return super().list_status_marks()
        return (
            f"{_('MACHINE')}: {frame_words.name_state(live.row.state, live.why_state)}",
            *super().list_status_marks(),
        )

    def list_trend_points(self) -> tuple[TrendPoint, ...]:
        """Return the points of the trend of target and applied rate."""
        job = self.find_replayed()
        if job is None:
            return self.app.history.list_recent_points()
        source = job.source
        return sample_points(
            # The trend of a log ends at the played position.
            source.frames,
            source.find_first_index(source.at_s - TREND_SPAN_S),
            source.frame_index,
        )

    def find_series(self) -> TrendSeries:
        """Return the series of the machine or the log."""
        return (
            self.app.history.series
            if self.find_replayed() is None
            else self.find_log_history().series
        )

    def find_worked_ground(self) -> WorkedGround:
        """Return the worked ground so far. A log is entered in parts over several refreshes, so
        that the screen responds."""
        job = self.find_replayed()
        if job is None:
            return self.app.history.worked
        history = self.find_log_history()
        # The rest follows with the next refresh.
        if not history.enter_up_to(job.source.frame_index):
            self.maps.make_due()
        return history.worked

    def find_ground(self, frame: Frame | None) -> tuple[WorkedGround, FieldPicture | None]:
        """Return worked ground and field; the field's machine determines width and sections."""
        picture, worked = self.app.fields.find_picture(frame), self.find_worked_ground()
        if picture is not None:
            worked.width_m, worked.sections = picture.width_m, picture.sections
        return worked, picture

    def make_map_view(
        self,
        frame: Frame | None,
        age_s: float,
        layer: MapLayer,
        camera: MapCamera,
        laid: OverlayFile | None = None,
    ) -> MapView:
        """Return a map's view of a frame, and of an overlaid file."""
        worked, picture = self.find_ground(frame)
        # A live map has a constant scale; a log is scaled by its own rates.
        most_kg_ha = self.app.crop_limits_kg_ha[1] if self.find_replayed() is None else None
        scale = find_colour_scale(
            layer,
            worked,
            picture,
            self.app.units,
            laid.rate_ends if laid is not None else None,
            most_kg_ha,
        )
        by = laid.find_scale(scale) if laid is not None else None
        return MapView(
            worked,
            worked.version,
            picture,
            scale,
            camera,
            frame.place_m if frame else None,
            frame.row.heading_deg if frame else None,
            stale=age_s > MAX_FRESH_AGE_S,
            lines=self.app.guide.list_drawn_lines(camera),
            laid=OverlayView(laid.worked, by) if laid is not None and by is not None else None,
        )

    def find_whole_box(self, frame: Frame | None) -> GroundBox | None:
        """Return the box round field, worked ground and machine."""
        worked, picture = self.find_ground(frame)
        place = (
            GroundBox(*frame.place_m, *frame.place_m)
            if frame is not None and frame.place_m is not None
            else None
        )
        return unite_boxes(picture.box if picture is not None else None, worked.box, place)

"""What every screen has: state and alarms above, pages and keys below, and how often it is
looked at."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from rich.cells import cell_len
from textual import events, getters
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.content import Content
from textual.css.scalar import Scalar
from textual.screen import Screen
from topdress.console.app.action import ANYWHERE, DIAGNOSIS, JOB, MAP, REPLAY, RUN, Action
from topdress.console.app.presence_text import CompanyView
from topdress.console.app.refresh_rates import MAPS_S, NUMBERS_S, PLOTS_S, RefreshTimer
from topdress.console.app.view import (
    AlarmsView,
    RunView,
    hide_lost_machine,
    hide_no_machine,
    make_run_view,
)
from topdress.console.app.widgets.alarm_bar import AlarmBar, count_rows_needed
from topdress.console.app.widgets.key_bar import KeyBar, KeysView
from topdress.console.app.widgets.panel import DrawnWidget, Panel, fit_width, make_line, wrap_text
from topdress.console.app.widgets.rates import SmallPanel, SmallView
from topdress.console.app.widgets.status_line import (
    PageBar,
    PagesView,
    StatusLine,
    TourBar,
    TourView,
    count_tour_rows,
)
from topdress.console.frame import Frame
from topdress.console.locale import _


class NoticeRows(Panel[str]):
    """Shows over the last rows of a page, above the keys, a notice for which the row next to them
    is too short."""

    def draw_rows(self, view: str, width: int, height: int) -> list[Content]:
        return [
            make_line((fit_width(f" {row}", width), "bold reverse"))
            for row in wrap_text(view, width - 2)
        ]

    def show_notice(self, text: str, room: int, width: int) -> None:
        """Show a notice. room: cells of the row next to hold and STOP, which is enough for most."""
        long = text if cell_len(text) + 1 > room else ""
        self.display = bool(long)
        if long:
            self.styles.height = len(wrap_text(long, width - 2))
        self.show_view(long)


class CompanyBar(Panel[CompanyView | None]):
    """Shows a row under the alarms while somebody else is at the machine too: the latest order and
    its console, then who is there. A click lists everybody."""

    def draw_rows(self, view: CompanyView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        order = f" {view.order}  " if view.order else ""
        return [
            make_line(
                (order, "bold"), (fit_width(f" {view.others}", width - cell_len(order)), "$muted")
            )
        ]

    async def on_click(self, event: events.Click) -> None:
        """List everybody."""
        event.stop()
        await self.run_action("app.company")


if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp

LEAST_COLUMNS, LEAST_ROWS = 80, 24
# on a narrow and high screen these stand under the numbers
PORTRAIT_COLUMNS, PORTRAIT = 60, (RUN, MAP, JOB)
# from here on numerals and state are drawn twice as large
HUGE_COLUMNS, HUGE_ROWS = 150, 46
MIDDLE_ROWS, TALL_ROWS = 28, 36
ALARM_ROWS, MOST_ALARM_ROWS = 3, 7
# at low and middle height, as their style sheets have it
LOW_ALARM_ROWS = {REPLAY: (1, 2), DIAGNOSIS: (2, 2)}
LOST_AGE_S = 1.1  # old enough to be greyed


class Page(Screen[None]):
    """Shows a screen reached by a key of its own.

    A subclass gives `where`, `compose_body` and its content; its keys stand next to it in
    `keys.py`. Below 80 x 24 state, alarms, the machine's numbers and keys are left; on a narrow
    screen with the height, a tablet on end, Run, Map and Job too.
    """

    AUTO_FOCUS = ""
    # else Textual moves the focus
    BINDINGS: ClassVar = [Binding("tab", "app.do('pages')", id="pages", show=False)]
    where: ClassVar[str] = ANYWHERE
    HORIZONTAL_BREAKPOINTS = [(0, "-tiny-columns"), (LEAST_COLUMNS, "-narrow"), (100, "-wide")]
    VERTICAL_BREAKPOINTS = [(0, "-tiny-rows"), (LEAST_ROWS, "-low"), (28, "-middle"), (36, "-tall")]

    if TYPE_CHECKING:
        app = getters.app(TopdressApp)

    def __init__(self) -> None:
        super().__init__(classes="panels")
        self.numbers, self.plots, self.maps = (
            RefreshTimer(NUMBERS_S),
            RefreshTimer(PLOTS_S),
            RefreshTimer(MAPS_S),
        )

    def compose(self) -> ComposeResult:
        """Lay out the page."""
        view = self.make_view_at(self.app.clock())
        yield StatusLine(view.status, id="status")
        yield AlarmBar(view.alarms, id="alarms")
        yield CompanyBar(None, id="company")
        yield TourBar(None, id="tour")
        yield from self.compose_extra()
        with Horizontal(id="body"):
            yield from self.compose_body()
        yield SmallPanel(SmallView(view.rates, view.tiles, ""), id="small")
        yield PageBar(PagesView((), ""), id="pages")
        yield KeyBar(KeysView((), False, ""), id="keys")
        yield NoticeRows("", id="notice")

    def compose_extra(self) -> ComposeResult:
        """Panels between the alarms and the body."""
        yield from ()

    def compose_body(self) -> ComposeResult:
        """Panels between alarms and keys."""
        yield from ()

    def on_resize(self, event: events.Resize) -> None:
        """Set the classes of size."""
        width, height = event.size
        self.set_class(width >= HUGE_COLUMNS and height >= HUGE_ROWS, "-huge")
        self.set_class(
            PORTRAIT_COLUMNS <= width < LEAST_COLUMNS
            and height >= TALL_ROWS
            and self.where in PORTRAIT,
            "-portrait",
        )
        self.refresh_all_next_tick()

    def perform_action(self, action: Action) -> None:
        """Do one of the page's own actions, seen at once. A subclass decides what comes before."""
        action.do(self)
        self.app.show_changes()

    def gather_frame(self, frame: Frame) -> None:
        """Take a new frame; called also while another page is shown."""

    def refresh_all_next_tick(self) -> None:
        """Refresh everything with the next tick."""
        for pace in (self.numbers, self.plots, self.maps):
            pace.hurry_up()

    def redraw_all(self) -> None:
        """Draw anew after another language or theme: views may be equal and yet look different."""
        self.refresh_all_next_tick()
        for drawn in self.query(DrawnWidget):
            drawn.refresh()

    def show_due(self, now_s: float) -> None:
        """Show what is due; called often. A subclass adds its own panels."""
        if self.numbers.is_due(now_s):
            self.show_numbers(self.make_view_at(now_s))

    def make_view_at(self, now_s: float) -> RunView:
        """The view at this time: a page never shows less, or other, than the one before it, also
        not while it is made."""
        frame, age_s = self.find_frame(now_s)
        view = self.make_view(frame, age_s)
        if frame is None and self.app.source is None and self.where != REPLAY:
            return hide_no_machine(view, self.app.find_shown_key("stop"))
        return hide_lost_machine(view, self.app.find_shown_key("stop")) if self.app.gone else view

    def find_frame(self, now_s: float) -> tuple[Frame | None, float]:
        """The frame to show, and its age, s. Without a worker the last values are old at once."""
        age_s = self.app.arrival.calc_age_s(now_s)
        return self.app.arrival.frame, max(age_s, LOST_AGE_S) if self.app.gone else age_s

    def make_view(self, frame: Frame | None, age_s: float) -> RunView:
        """The view of a frame."""
        return make_run_view(
            frame, age_s, self.app.units, self.app.utc_offset_s, self.list_status_marks()
        )

    def show_numbers(self, view: RunView) -> None:
        """Show state, alarms, keys; a subclass adds its numbers."""
        self.query_one("#status", StatusLine).show_view(view.status)
        self.query_one("#alarms", AlarmBar).show_view(view.alarms)
        # else it hides what is at fault: the board
        in_full = self.where == RUN or self.size.height >= TALL_ROWS
        self.set_class(bool(view.alarms.fault and view.alarms.lines) and in_full, "-fault")
        self._fit_alarm_rows(view.alarms)
        small = self.query_one("#small", SmallPanel)
        if small.display:
            page = (
                ""
                if self.where in (RUN, REPLAY) or self.has_class("-portrait")
                else next(
                    (
                        _(one.label)
                        for one in self.app.page_actions
                        if one.id == f"{self.where}_screen"
                    ),
                    "",
                )
            )
            small.show_view(
                SmallView(
                    view.rates,
                    view.tiles,
                    _("{columns} x {rows} shows the whole page").format(
                        columns=LEAST_COLUMNS, rows=LEAST_ROWS
                    ),
                    page,
                )
            )
        company, others = self.query_one("#company", CompanyBar), self.app.make_company_view()
        company.display = others is not None
        company.show_view(others)
        self.show_tour()
        self.show_keys()

    def _fit_alarm_rows(self, shown: AlarmsView) -> None:
        """Give the alarms more rows than the style sheet's where the worst alarm needs them to be
        read to its end."""
        bar = self.query_one("#alarms", AlarmBar)
        low, middle = LOW_ALARM_ROWS.get(self.where, (ALARM_ROWS, ALARM_ROWS))
        rows = self.size.height
        least = low if rows < MIDDLE_ROWS else middle if rows < TALL_ROWS else ALARM_ROWS
        need = (
            count_rows_needed(shown, self.size.width, todo=least >= ALARM_ROWS)
            if shown.lines or shown.urgent
            else 0
        )
        height = (
            min(need, MOST_ALARM_ROWS) if need > least and not self.has_class("-fault") else None
        )
        if bar.styles.inline.height != (None if height is None else Scalar.from_number(height)):
            bar.styles.height = height

    def show_tour(self) -> None:
        """Show the guided tour's rows, while there is one."""
        bar, tour = self.query_one("#tour", TourBar), self.app.tour
        bar.display = tour is not None
        if tour is not None:
            bar.styles.height = count_tour_rows(_(tour.text), self.size.width)
            bar.show_view(TourView(tour.index + 1, len(tour.steps), _(tour.text)))

    def show_keys(self) -> None:
        """Show the key bar."""
        offered = self.app.list_offered_actions(self.where)
        off = frozenset(
            action.id for action in offered if action.bar and self.app.explain_not_now(action)
        )
        keys, text = self.query_one("#keys", KeyBar), self.app.notice_text
        keys.show_view(KeysView(offered, self.app.locked, text, self.app.explain_no_stop(), off))
        self.query_one("#notice", NoticeRows).show_notice(
            text, keys.count_notice_cells(offered), self.size.width
        )
        self.query_one("#pages", PageBar).show_view(PagesView(self.app.page_actions, self.where))

    def list_status_marks(self) -> tuple[str, ...]:
        """Words that stand in the status line until they are untrue."""
        gone = (_("NO CONNECTION"),) if self.app.gone else ()
        own = (*gone, *self.app.list_status_marks())
        return (*own, _("LOCKED")) if self.app.locked else own

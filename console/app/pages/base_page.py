"""Defines the parts that every screen has: state and alarms at the top, pages and keys at the
bottom, refresh timers.
"""

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
from topdress.console.app.panel_views import (
    AlarmsView,
    RunView,
    make_run_view,
    mask_lost_machine,
    mask_missing_machine,
)
from topdress.console.app.presence_text import PresenceView
from topdress.console.app.refresh_rates import (
    MAPS_PERIOD_S,
    NUMBERS_PERIOD_S,
    PLOTS_PERIOD_S,
    RefreshTimer,
)
from topdress.console.app.widgets.alarm_bar import AlarmBar, count_rows_needed
from topdress.console.app.widgets.base_panel import (
    DrawnWidget,
    Panel,
    fit_text_width,
    make_line,
    wrap_text,
)
from topdress.console.app.widgets.key_bar import KeyBar, KeysView
from topdress.console.app.widgets.rate_panels import SmallPanel, SmallView
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
    """Shows a notice over the last rows of a page where the row next to hold and STOP is too short
    for it."""

    def draw_rows(self, view: str, width: int, height: int) -> list[Content]:
        return [
            make_line((fit_text_width(f" {row}", width), "bold reverse"))
            for row in wrap_text(view, width - 2)
        ]

    def show_notice(self, text: str, room: int, width: int) -> None:
        """Show a notice; `room` is the number of cells next to hold and STOP."""
        long = text if cell_len(text) + 1 > room else ""
        self.display = bool(long)
        if long:
            self.styles.height = len(wrap_text(long, width - 2))
        self.show_view(long)


class PresenceBar(Panel[PresenceView | None]):
    """Shows a row below the alarms while other consoles are at the machine: the latest order and
    its console, then the consoles. A click lists everybody."""

    def draw_rows(self, view: PresenceView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        order = f" {view.order}  " if view.order else ""
        return [
            make_line(
                (order, "bold"),
                (fit_text_width(f" {view.others}", width - cell_len(order)), "$muted"),
            )
        ]

    async def on_click(self, event: events.Click) -> None:
        """List everybody at this machine."""
        event.stop()
        await self.run_action("app.company")


if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp

# Size below which a page has no room: the size of a classic terminal.
MIN_PAGE_COLUMNS, MIN_PAGE_ROWS = 80, 24
# On a narrow and high screen, such as an upright tablet, these pages appear below the numbers.
MIN_PORTRAIT_COLUMNS, PORTRAIT_PAGES = 60, (RUN, MAP, JOB)
# From this size, numerals and state are drawn twice as large.
HUGE_COLUMNS, HUGE_ROWS = 150, 46
# Heights from which the style sheets show more panels.
MIDDLE_ROWS, TALL_ROWS = 28, 36
# Rows of the alarms, normally and at most.
ALARM_ROWS, MAX_ALARM_ROWS = 3, 7
# Rows of the alarms at low and at middle height; the style sheets of these pages have the same
# numbers.
LOW_ALARM_ROWS = {REPLAY: (1, 2), DIAGNOSIS: (2, 2)}
# Age at which values are grey, s; values of a lost worker count as this old at once.
LOST_FRAME_AGE_S = 1.1


class Page(Screen[None]):
    """Shows a screen that has a key of its own.

    A subclass defines `where`, `compose_body` and its content; its keys are in its `keys.py`.
    Below 80 x 24 only state, alarms, the machine's numbers and keys remain. On a narrow screen of
    sufficient height, Run, Map and Job appear too.
    """

    AUTO_FOCUS = ""
    # Without this binding Textual would use Tab to move the focus.
    BINDINGS: ClassVar = [Binding("tab", "app.do('pages')", id="pages", show=False)]
    where: ClassVar[str] = ANYWHERE
    # Textual sets these classes by size; the style sheets of the pages decide by them what is
    # visible.
    HORIZONTAL_BREAKPOINTS = [(0, "-tiny-columns"), (MIN_PAGE_COLUMNS, "-narrow"), (100, "-wide")]
    VERTICAL_BREAKPOINTS = [
        (0, "-tiny-rows"),
        (MIN_PAGE_ROWS, "-low"),
        (28, "-middle"),
        (36, "-tall"),
    ]

    if TYPE_CHECKING:
        app = getters.app(TopdressApp)

    def __init__(self) -> None:
        super().__init__(classes="panels")
        self.numbers, self.plots, self.maps = (
            RefreshTimer(NUMBERS_PERIOD_S),
            RefreshTimer(PLOTS_PERIOD_S),
            RefreshTimer(MAPS_PERIOD_S),
        )

    def compose(self) -> ComposeResult:
        """Yield the panels of the page."""
        view = self.make_view_at(self.app.clock())
        yield StatusLine(view.status, id="status")
        yield AlarmBar(view.alarms, id="alarms")
        yield PresenceBar(None, id="company")
        yield TourBar(None, id="tour")
        yield from self.compose_extra()
        with Horizontal(id="body"):
            yield from self.compose_body()
        # The small panel replaces the body on a screen below 80 x 24; the style sheet shows one of
        # both.
        yield SmallPanel(SmallView(view.rates, view.tiles, ""), id="small")
        yield PageBar(PagesView((), ""), id="pages")
        yield KeyBar(KeysView((), False, ""), id="keys")
        yield NoticeRows("", id="notice")

    def compose_extra(self) -> ComposeResult:
        """Yield the panels between alarms and body."""
        yield from ()

    def compose_body(self) -> ComposeResult:
        """Yield the panels between alarms and keys."""
        yield from ()

    def on_resize(self, event: events.Resize) -> None:
        """Set the classes for sizes that Textual's breakpoints cannot express."""
        width, height = event.size
        self.set_class(width >= HUGE_COLUMNS and height >= HUGE_ROWS, "-huge")
        self.set_class(
            MIN_PORTRAIT_COLUMNS <= width < MIN_PAGE_COLUMNS
            and height >= TALL_ROWS
            and self.where in PORTRAIT_PAGES,
            "-portrait",
        )
        self.refresh_all_next_tick()

    def perform_action(self, action: Action) -> None:
        """Perform an action of the page and show its result at once. Subclasses add conditions."""
        action.do(self)
        self.app.show_changes()

    def gather_frame(self, frame: Frame) -> None:
        """Process a new frame; called also while another page is open."""

    def refresh_all_next_tick(self) -> None:
        """Refresh everything with the next tick."""
        for pace in (self.numbers, self.plots, self.maps):
            pace.make_due()

    def redraw_all(self) -> None:
        """Draw again after a change of language or theme: equal views may look different."""
        self.refresh_all_next_tick()
        for drawn in self.query(DrawnWidget):
            drawn.refresh()

    def show_due(self, now_s: float) -> None:
        """Show what is due. Called often; subclasses add their panels."""
        if self.numbers.is_due(now_s):
            self.show_numbers(self.make_view_at(now_s))

    def make_view_at(self, now_s: float) -> RunView:
        """Return the view at this time, also for a page that is being composed, so that no page
        shows less than the page before."""
        frame, age_s = self.find_frame(now_s)
        view = self.make_view(frame, age_s)
        # Without a source ever, no machine is known: numbers would be misleading.
        if frame is None and self.app.source is None and self.where != REPLAY:
            return mask_missing_machine(view, self.app.find_shown_key("stop"))
        return mask_lost_machine(view, self.app.find_shown_key("stop")) if self.app.gone else view

    def find_frame(self, now_s: float) -> tuple[Frame | None, float]:
        """Return the frame to show and its age, s. Without a worker the last values count as old at
        once."""
        age_s = self.app.arrival.calc_age_s(now_s)
        return self.app.arrival.frame, max(age_s, LOST_FRAME_AGE_S) if self.app.gone else age_s

    def make_view(self, frame: Frame | None, age_s: float) -> RunView:
        """Return the view of a frame."""
        return make_run_view(
            frame, age_s, self.app.units, self.app.utc_offset_s, self.list_status_marks()
        )

    def show_numbers(self, view: RunView) -> None:
        """Show state, alarms and keys; a subclass adds its numbers."""
        self.query_one("#status", StatusLine).show_view(view.status)
        self.query_one("#alarms", AlarmBar).show_view(view.alarms)
        # On a low screen the full text of a fault would cover the panel of the device at fault.
        in_full = self.where == RUN or self.size.height >= TALL_ROWS
        self.set_class(bool(view.alarms.fault and view.alarms.lines) and in_full, "-fault")
        self._fit_alarm_rows(view.alarms)
        small = self.query_one("#small", SmallPanel)
        # A hidden panel needs no view.
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
                        columns=MIN_PAGE_COLUMNS, rows=MIN_PAGE_ROWS
                    ),
                    page,
                )
            )
        company, others = self.query_one("#company", PresenceBar), self.app.make_presence_view()
        company.display = others is not None
        company.show_view(others)
        self.show_tour()
        self.show_keys()

    def _fit_alarm_rows(self, shown: AlarmsView) -> None:
        """Give the alarms more rows than the style sheet where the worst alarm needs them to be
        read completely."""
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
            min(need, MAX_ALARM_ROWS) if need > least and not self.has_class("-fault") else None
        )
        # Setting an equal height would trigger a layout of the whole page.
        if bar.styles.inline.height != (None if height is None else Scalar.from_number(height)):
            bar.styles.height = height

    def show_tour(self) -> None:
        """Show the rows of the guided tour while it runs."""
        bar, tour = self.query_one("#tour", TourBar), self.app.tour
        bar.display = tour is not None
        if tour is not None:
            bar.styles.height = count_tour_rows(_(tour.text), self.size.width)
            bar.show_view(TourView(tour.index + 1, len(tour.steps), _(tour.text)))

    def show_keys(self) -> None:
        """Show the key bar, with keys grey whose action is impossible now."""
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
        """Return words for the status line that stay while they are true."""
        gone = (_("NO CONNECTION"),) if self.app.gone else ()
        own = (*gone, *self.app.list_status_marks())
        return (*own, _("LOCKED")) if self.app.locked else own

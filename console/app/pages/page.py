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
from topdress.console.app.refresh_rates import MAPS_S, NUMBERS_S, PLOTS_S, Pace
from topdress.console.app.view import AlarmsView, RunView, look, without_machine, without_worker
from topdress.console.app.widgets.alarm_bar import AlarmBar, count_rows_needed
from topdress.console.app.widgets.key_bar import KeyBar, KeysView
from topdress.console.app.widgets.panel import Drawn, Panel, fit, line, wrapped
from topdress.console.app.widgets.rates import Small, SmallView
from topdress.console.app.widgets.status_line import (
    PageBar,
    PagesView,
    StatusLine,
    TourBar,
    TourView,
    rows_of,
)
from topdress.console.frame import Frame
from topdress.console.locale import _


class NoticeRows(Panel[str]):
    """Over the last rows of a page, above the keys: what was refused or done, where the row
    next to them is too short."""

    def lines(self, view: str, width: int, height: int) -> list[Content]:
        return [line((fit(f" {row}", width), "bold reverse")) for row in wrapped(view, width - 2)]

    def say(self, text: str, room: int, width: int) -> None:
        """room: cells of the row next to hold and STOP, which is enough for most."""
        long = text if cell_len(text) + 1 > room else ""
        self.display = bool(long)
        if long:
            self.styles.height = len(wrapped(long, width - 2))
        self.show(long)


class CompanyBar(Panel[CompanyView | None]):
    """A row under the alarms while somebody else is at the machine too: the latest order and
    whose it is, then who is there. A click lists everybody."""

    def lines(self, view: CompanyView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        order = f" {view.order}  " if view.order else ""
        return [line((order, "bold"), (fit(f" {view.others}", width - cell_len(order)), "$muted"))]

    async def on_click(self, event: events.Click) -> None:
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
ALARM_ROWS_LOW = {REPLAY: (1, 2), DIAGNOSIS: (2, 2)}
GONE_AGE_S = 1.1  # old enough to be greyed


class Page(Screen[None]):
    """A screen reached by a key of its own. A subclass gives `where`, `body` and what it shows;
    its keys stand next to it in `keys.py`. Below 80 x 24 state, alarms, the machine's numbers
    and keys are left; on a narrow screen with the height, a tablet on end, Run, Map and Job
    too."""

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
        self.numbers, self.plots, self.maps = Pace(NUMBERS_S), Pace(PLOTS_S), Pace(MAPS_S)

    def compose(self) -> ComposeResult:
        view = self.view_at(self.app.clock())
        yield StatusLine(view.status, id="status")
        yield AlarmBar(view.alarms, id="alarms")
        yield CompanyBar(None, id="company")
        yield TourBar(None, id="tour")
        yield from self.extra()
        with Horizontal(id="body"):
            yield from self.body()
        yield Small(SmallView(view.rates, view.tiles, ""), id="small")
        yield PageBar(PagesView((), ""), id="pages")
        yield KeyBar(KeysView((), False, ""), id="keys")
        yield NoticeRows("", id="notice")

    def extra(self) -> ComposeResult:
        """Panels between the alarms and the body."""
        yield from ()

    def body(self) -> ComposeResult:
        """What stands between alarms and keys."""
        yield from ()

    def on_resize(self, event: events.Resize) -> None:
        width, height = event.size
        self.set_class(width >= HUGE_COLUMNS and height >= HUGE_ROWS, "-huge")
        self.set_class(
            PORTRAIT_COLUMNS <= width < LEAST_COLUMNS
            and height >= TALL_ROWS
            and self.where in PORTRAIT,
            "-portrait",
        )
        self.hurry()

    def perform(self, action: Action) -> None:
        """One of the page's own actions, seen at once. A subclass says what comes before."""
        action.do(self)
        self.app.look()

    def gather(self, frame: Frame) -> None:
        """A new frame has come; called also while another page is looked at."""

    def hurry(self) -> None:
        """Everything is looked at with the next tick."""
        for pace in (self.numbers, self.plots, self.maps):
            pace.hurry()

    def redraw(self) -> None:
        """After another language or theme: views may be equal and yet look different."""
        self.hurry()
        for drawn in self.query(Drawn):
            drawn.refresh()

    def tick(self, now_s: float) -> None:
        """Look at what is new; called often, does only what is due. A subclass adds its own
        panels to it."""
        if self.numbers.due(now_s):
            self.show_numbers(self.view_at(now_s))

    def view_at(self, now_s: float) -> RunView:
        """What is known now: a page never says less, or other, than the one before it, also not
        while it is made."""
        frame, age_s = self.seen(now_s)
        view = self.seen_view(frame, age_s)
        if frame is None and self.app.source is None and self.where != REPLAY:
            return without_machine(view, self.app.shown_key("stop"))
        return without_worker(view, self.app.shown_key("stop")) if self.app.gone else view

    def seen(self, now_s: float) -> tuple[Frame | None, float]:
        """The frame to show, and its age in s. Without a worker the last values are old at once."""
        age_s = self.app.arrival.age_s(now_s)
        return self.app.arrival.frame, max(age_s, GONE_AGE_S) if self.app.gone else age_s

    def seen_view(self, frame: Frame | None, age_s: float) -> RunView:
        return look(frame, age_s, self.app.units, self.app.utc_offset_s, self.marks())

    def show_numbers(self, view: RunView) -> None:
        """State, alarms, keys; a subclass adds its numbers."""
        self.query_one("#status", StatusLine).show(view.status)
        self.query_one("#alarms", AlarmBar).show(view.alarms)
        # else it hides what is at fault: the board
        in_full = self.where == RUN or self.size.height >= TALL_ROWS
        self.set_class(bool(view.alarms.fault and view.alarms.lines) and in_full, "-fault")
        self._room_for_alarms(view.alarms)
        small = self.query_one("#small", Small)
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
            small.show(
                SmallView(
                    view.rates,
                    view.tiles,
                    _("{columns} x {rows} shows the whole page").format(
                        columns=LEAST_COLUMNS, rows=LEAST_ROWS
                    ),
                    page,
                )
            )
        company, others = self.query_one("#company", CompanyBar), self.app.company_view()
        company.display = others is not None
        company.show(others)
        self.show_tour()
        self.show_keys()

    def _room_for_alarms(self, shown: AlarmsView) -> None:
        """More rows than the style sheet's where the worst alarm needs them to be read to its
        end."""
        bar = self.query_one("#alarms", AlarmBar)
        low, middle = ALARM_ROWS_LOW.get(self.where, (ALARM_ROWS, ALARM_ROWS))
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
        """The guided tour's rows, while there is one."""
        bar, tour = self.query_one("#tour", TourBar), self.app.tour
        bar.display = tour is not None
        if tour is not None:
            bar.styles.height = rows_of(_(tour.text), self.size.width)
            bar.show(TourView(tour.index + 1, len(tour.steps), _(tour.text)))

    def show_keys(self) -> None:
        offered = self.app.offered(self.where)
        off = frozenset(action.id for action in offered if action.bar and self.app.why_not(action))
        keys, text = self.query_one("#keys", KeyBar), self.app.notice_text
        keys.show(KeysView(offered, self.app.locked, text, self.app.why_no_stop(), off))
        self.query_one("#notice", NoticeRows).say(
            text, keys.room_for_notice(offered), self.size.width
        )
        self.query_one("#pages", PageBar).show(PagesView(self.app.page_actions, self.where))

    def marks(self) -> tuple[str, ...]:
        """Words that stand in the status line until they are untrue."""
        gone = (_("NO CONNECTION"),) if self.app.gone else ()
        own = (*gone, *self.app.marks())
        return (*own, _("LOCKED")) if self.app.locked else own

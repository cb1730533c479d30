"""Defines the keys of the Trends page and their functions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app.action import TRENDS, Action, set_page
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.trends.page import TrendsScreen

# Share of the span by which the cursor moves with Shift.
CURSOR_FAR_STEP_SHARE = 0.1
# Share of the span by which PgUp and PgDn scroll: half keeps the context visible.
SCROLL_SPAN_SHARE = 0.5


def show_whole_run(page: TrendsScreen) -> None:
    """Show the whole run."""
    page.span, page.ends_s = None, None


def drop_cursor(page: TrendsScreen) -> None:
    """Remove the cursor."""
    page.cursor_s = None


def toggle_machine_or_log(page: TrendsScreen) -> None:
    """Switch between the machine and the replayed log."""
    page.toggle_log()
    # Times and scales of the machine are meaningless for a log.
    page.ends_s = page.cursor_s = page.fixed = None


ACTIONS = set_page(
    TRENDS,
    Action(
        "trends_channels",
        "v",
        "V",
        N_("channels"),
        N_("What is plotted, up to three; also a click on a name."),
        lambda page: page.ask_channels(),
        bar=3,
    ),
    Action(
        "trends_shorter",
        "plus,equals_sign,kp_plus",
        "+",
        N_("shorter"),
        N_("A shorter span; also by the wheel."),
        lambda page: page.change_span(-1),
        bar=4,
    ),
    Action(
        "trends_longer",
        "minus,kp_minus",
        "-",
        N_("longer"),
        N_("A longer span; also by the wheel."),
        lambda page: page.change_span(1),
        bar=5,
    ),
    Action(
        # Y stops movement on every page: following on the map, playing in the replay.
        "trends_freeze",
        "y",
        "Y",
        N_("freeze"),
        N_("Freezes the plots, or lets them run."),
        lambda page: page.toggle_freeze(),
        bar=6,
    ),
    Action(
        "trends_whole",
        "z",
        "Z",
        N_("whole run"),
        N_("All of the run or log."),
        show_whole_run,
        bar=7,
    ),
    Action(
        # A fixed scale lets the operator compare spans.
        "trends_scale",
        "q_2",
        "Q2",
        N_("fixed scale"),
        N_("Keeps the scales as they are, or fits them to the values."),
        lambda page: page.toggle_scale(),
    ),
    # Reading and scrolling send nothing to the machine, so no key of this page needs a connection.
    Action(
        "trends_left",
        "left",
        "<",
        N_("cursor back"),
        N_("Reads the values at a time; also a click in the plot."),
        lambda page: page.move_cursor(-page.calc_cell_s()),
    ),
    Action(
        "trends_right",
        "right",
        ">",
        N_("cursor on"),
        N_("Reads the values at a time; also a click in the plot."),
        lambda page: page.move_cursor(page.calc_cell_s()),
    ),
    Action(
        "trends_far_left",
        "shift+left",
        "S-<",
        N_("cursor far back"),
        N_("A tenth of the span at once."),
        lambda page: page.move_cursor(-CURSOR_FAR_STEP_SHARE * page.find_window().length_s),
    ),
    Action(
        "trends_far_right",
        "shift+right",
        "S->",
        N_("cursor far on"),
        N_("A tenth of the span at once."),
        lambda page: page.move_cursor(CURSOR_FAR_STEP_SHARE * page.find_window().length_s),
    ),
    Action(
        "trends_cursor_off",
        "escape",
        "Esc",
        N_("cursor away"),
        N_("Back to the newest values."),
        drop_cursor,
        why=lambda page: _("no cursor is set") if page.cursor_s is None else "",
    ),
    Action(
        # Scrolling freezes the plots, because new rows would move the span.
        "trends_earlier",
        "pageup",
        "PgUp",
        N_("earlier"),
        N_("Half a span back; the plots stand still."),
        lambda page: page.scroll_span(-SCROLL_SPAN_SHARE),
    ),
    Action(
        "trends_later",
        "pagedown",
        "PgDn",
        N_("later"),
        N_("Half a span on."),
        lambda page: page.scroll_span(SCROLL_SPAN_SHARE),
    ),
    Action(
        "trends_log",
        "q_1",
        "Q1",
        N_("machine / log"),
        N_("The machine at work, or the log of the replay."),
        toggle_machine_or_log,
        why=lambda page: page.explain_no_turn(),
    ),
)

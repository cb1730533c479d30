"""Defines the keys of the Replay page and their functions."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from topdress.console.app import frame_words
from topdress.console.app.action import REPLAY, Action, set_page
from topdress.console.app.dialogs import Choice, ChoiceDialog, TextDialog
from topdress.console.locale import N_, _
from topdress.control.orders import STRATEGIES

if TYPE_CHECKING:
    from topdress.console.app.pages.replay.page import ReplayScreen
    from topdress.console.app.pages.replay.service import LogFile, LogFiles

# Step of the keys that seek, s.
SEEK_STEP_S = 30.0


def ask_log(page: ReplayScreen) -> None:
    """Ask for a log and open it."""
    files = page.app.services.logs
    if files is None:
        page.app.show_notice(_("there is no log yet"))
    else:
        page.app.read_for_page(files.list_logs, partial(_choose_log, page, files))


def _choose_log(page: ReplayScreen, files: LogFiles, listed: tuple[LogFile, ...]) -> None:
    """Ask for one of the listed logs."""
    # An empty list would offer nothing.
    if not listed:
        page.app.show_notice(_("there is no log yet"))
        return
    choices = [Choice(one.path, f"{one.name}  {one.changed}  {one.size}") for one in listed]
    page.app.ask_question(
        ChoiceDialog(_("Open a log"), choices, ""), lambda path: page.read_log(files, path)
    )


def seek_next_alarm(page: ReplayScreen) -> None:
    """Seek the next alarm."""
    if not page.player.seek_next_alarm():
        page.app.show_notice(_("no further alarm in this log"))


def ask_what_if(page: ReplayScreen) -> None:
    """Ask for another strategy, crop or machine, and recompute the log with it."""
    # The alternatives come with the log, because they depend on its machine.
    job = page.opened_job
    # The value has kind and name, because the list mixes three kinds of choices.
    choices = [
        Choice(f"strategy:{name}", f"{_('strategy')}: {frame_words.name_strategy(name)}")
        for name in STRATEGIES
    ]
    choices += [Choice(f"crop:{name}", f"{_('crop')}: {name}") for name in job.crops]
    choices += [Choice(f"machine:{name}", f"{_('machine')}: {name}") for name in job.machines]
    page.app.ask_question(
        ChoiceDialog(_("What if"), choices, "", _("changes add up; Del goes back to the log")),
        page.begin_what_if,
    )


def show_findings(page: ReplayScreen) -> None:
    """Show the notes on the log."""
    text = "\n".join(page.opened_job.findings) or _("nothing was found")
    page.app.push_screen(
        TextDialog(_("Findings about {name}").format(name=page.opened_job.name), text)
    )


def explain_no_log(page: ReplayScreen) -> str:
    """Return why nothing can be played: no log is open."""
    return _("no log is open: J opens one") if page.job is None else ""


def explain_no_what_if(page: ReplayScreen) -> str:
    """Return why the log cannot be recomputed."""
    # A log of another program has no machine file to compute with.
    if page.job is not None and page.job.what_if is None:
        return _("this log cannot be recomputed: its machine or crop is not known")
    return explain_no_log(page)


ACTIONS = set_page(
    REPLAY,
    # Keys of replay change nothing on a machine, so none of them needs a connection.
    Action("open_log", "j", "J", N_("open"), N_("Another log, the newest first."), ask_log, bar=3),
    Action(
        "play",
        "y",
        "Y",
        N_("play / pause"),
        N_("Plays or pauses the log."),
        lambda page: page.player.toggle_playing(),
        bar=3,
        why=explain_no_log,
    ),
    Action(
        "step_back",
        "left",
        "<",
        N_("back"),
        N_("One row back."),
        lambda page: page.player.step_rows(-1),
        bar=4,
        why=explain_no_log,
    ),
    Action(
        "step_on",
        "right",
        ">",
        N_("on"),
        N_("One row on."),
        lambda page: page.player.step_rows(1),
        bar=5,
        why=explain_no_log,
    ),
    # Shift with an arrow works in terminals that use PgUp and PgDn for their own scrolling.
    Action(
        "seek_back",
        "pageup,shift+left",
        "PgUp",
        N_("-30 s"),
        N_("30 s back."),
        lambda page: page.player.seek_time(page.player.at_s - SEEK_STEP_S),
        bar=6,
        why=explain_no_log,
    ),
    Action(
        "seek_on",
        "pagedown,shift+right",
        "PgDn",
        N_("+30 s"),
        N_("30 s on."),
        lambda page: page.player.seek_time(page.player.at_s + SEEK_STEP_S),
        bar=7,
        why=explain_no_log,
    ),
    Action(
        "seek_start",
        "home",
        "Home",
        N_("start of log"),
        N_("To the first row."),
        lambda page: page.player.seek_time(page.player.start_s),
        why=explain_no_log,
    ),
    Action(
        "seek_end",
        "end",
        "End",
        N_("end of log"),
        N_("To the last row."),
        lambda page: page.player.seek_time(page.player.end_s),
        why=explain_no_log,
    ),
    Action(
        "slower",
        "left_square_bracket",
        "[",
        N_("slower"),
        N_("Half as fast, down to 0.1x."),
        lambda page: page.player.change_speed(-1),
        bar=8,
        why=explain_no_log,
    ),
    Action(
        "faster",
        "right_square_bracket",
        "]",
        N_("faster"),
        N_("Twice as fast, up to 1000x."),
        lambda page: page.player.change_speed(1),
        bar=8,
        why=explain_no_log,
    ),
    Action(
        "next_alarm",
        "down",
        "Down",
        N_("next alarm"),
        N_("To the next row on which a new alarm stands."),
        seek_next_alarm,
        why=explain_no_log,
    ),
    Action(
        # A recomputation takes seconds, so it runs in a thread and can be cancelled.
        "what_if",
        "q_1",
        "Q1",
        N_("what if"),
        N_("The same log with another strategy, crop or machine."),
        ask_what_if,
        why=explain_no_what_if,
    ),
    Action(
        "cancel_what_if",
        "escape",
        "Esc",
        N_("cancel"),
        N_("Stops computing a what-if."),
        lambda page: page.cancel_what_if(),
        why=lambda page: _("no what-if is being computed") if page.computing is None else "",
    ),
    Action(
        # The recorded frames are kept, so returning needs no file.
        "as_recorded",
        "delete,backspace",
        "Del",
        N_("as recorded"),
        N_("Back to the log as it was recorded."),
        lambda page: page.show_recorded(),
        why=explain_no_log,
    ),
    Action(
        "findings",
        "q_2",
        "Q2",
        N_("findings"),
        N_("What was found in this log when it was opened."),
        show_findings,
        why=explain_no_log,
    ),
)

"""Defines the keys of the Settings page."""

from __future__ import annotations

from topdress.console.app.action import SETTINGS, Action, set_page
from topdress.console.locale import N_, _
from topdress.drivers.files.settings import Settings

# Lines that PgUp and PgDn move.
PAGE_STEP_LINES = 10


ACTIONS = set_page(
    SETTINGS,
    Action(
        # The list is long, so it has keys for steps, pages and both ends.
        "setting_up",
        "up",
        "Up",
        N_("up"),
        N_("The setting above."),
        lambda page: page.move_mark(-1),
        locked=True,
    ),
    Action(
        "setting_down",
        "down",
        "Down",
        N_("down"),
        N_("The setting below."),
        lambda page: page.move_mark(1),
        bar=4,
        locked=True,
    ),
    Action(
        "setting_page_up",
        "pageup",
        "PgUp",
        N_("page up"),
        N_("Ten settings up."),
        lambda page: page.move_mark(-PAGE_STEP_LINES),
        locked=True,
    ),
    Action(
        "setting_page_down",
        "pagedown",
        "PgDn",
        N_("page down"),
        N_("Ten settings down."),
        lambda page: page.move_mark(PAGE_STEP_LINES),
        locked=True,
    ),
    Action(
        "setting_first",
        "home",
        "Home",
        N_("first"),
        N_("The first setting."),
        lambda page: page.move_mark(-len(page.list_rows())),
        locked=True,
    ),
    Action(
        "setting_last",
        "end",
        "End",
        N_("last"),
        N_("The last setting."),
        lambda page: page.move_mark(len(page.list_rows())),
        locked=True,
    ),
    # Moving the mark works while the keys are locked; changing a setting does not.
    Action(
        "setting_change",
        "enter",
        "Enter",
        N_("change"),
        N_("Changes the selected setting; it is saved at once."),
        lambda page: page.change_marked(),
        bar=3,
        asks="text",
    ),
    Action(
        # A default returns by the same rules as any other value.
        "setting_default",
        "delete,backspace",
        "Del",
        N_("default"),
        N_("Resets the selected setting."),
        lambda page: page.reset_marked(),
        bar=5,
    ),
    Action(
        "settings_defaults",
        "q_1",
        "Q1",
        N_("all defaults"),
        N_("Resets every setting; asks first."),
        lambda page: page.app.ask_yes_no(
            _("Reset all settings?"),
            _("Units, language, look, keys: everything."),
            lambda: page.use_settings(Settings()),
        ),
    ),
)

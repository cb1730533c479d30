"""Actions of the Settings screen."""
from __future__ import annotations

from console.app.action import SETTINGS, Action
from console.locale import N_

ACTIONS = (
    Action("setting_up", "up", "Up", N_("up"), N_("The setting above."), SETTINGS, locked=True),
    Action("setting_down", "down", "Down", N_("down"), N_("The setting below."), SETTINGS, 4, locked=True),
    Action("setting_page_up", "pageup", "PgUp", N_("page up"), N_("Ten settings up."), SETTINGS, locked=True),
    Action("setting_page_down", "pagedown", "PgDn", N_("page down"), N_("Ten settings down."), SETTINGS, locked=True),
    Action("setting_first", "home", "Home", N_("first"), N_("The first setting."), SETTINGS, locked=True),
    Action("setting_last", "end", "End", N_("last"), N_("The last setting."), SETTINGS, locked=True),
    Action("setting_change", "enter", "Enter", N_("change"), N_("Changes the marked setting; it is kept at once."),
           SETTINGS, 3),
    Action("setting_default", "delete,backspace", "Del", N_("default"), N_("The marked setting as it was delivered."),
           SETTINGS, 5),
    Action("settings_defaults", "r", "R", N_("all defaults"), N_("Every setting as it was delivered; asked once."),
           SETTINGS, 6),
)

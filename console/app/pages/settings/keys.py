"""Keys of the Settings page and what they do."""
from __future__ import annotations

from typing import TYPE_CHECKING

from console.app.action import SETTINGS, Action
from console.app.dialogs import Confirm
from console.locale import N_, _
from drivers.files.settings import Settings

if TYPE_CHECKING:
    from console.app.pages.settings.page import SettingsScreen

PAGE_STEP = 10


def up(page: SettingsScreen) -> None:
    page.move(-1)


def down(page: SettingsScreen) -> None:
    page.move(1)


def page_up(page: SettingsScreen) -> None:
    page.move(-PAGE_STEP)


def page_down(page: SettingsScreen) -> None:
    page.move(PAGE_STEP)


def first(page: SettingsScreen) -> None:
    page.move(-len(page.rows()))


def last(page: SettingsScreen) -> None:
    page.move(len(page.rows()))


def change(page: SettingsScreen) -> None:
    page.change()


def default(page: SettingsScreen) -> None:
    page.put_back()


def all_defaults(page: SettingsScreen) -> None:
    question = Confirm(_("Reset all settings?"), _("Units, language, look, keys: everything."))
    page.app.push_screen(question, lambda yes: page.take(Settings()) if yes else None)


ACTIONS = (
    Action("setting_up", "up", "Up", N_("up"), N_("The setting above."), up, SETTINGS, locked=True),
    Action("setting_down", "down", "Down", N_("down"), N_("The setting below."), down, SETTINGS, 4, locked=True),
    Action("setting_page_up", "pageup", "PgUp", N_("page up"), N_("Ten settings up."), page_up, SETTINGS, locked=True),
    Action("setting_page_down", "pagedown", "PgDn", N_("page down"), N_("Ten settings down."), page_down, SETTINGS,
           locked=True),
    Action("setting_first", "home", "Home", N_("first"), N_("The first setting."), first, SETTINGS, locked=True),
    Action("setting_last", "end", "End", N_("last"), N_("The last setting."), last, SETTINGS, locked=True),
    Action("setting_change", "enter", "Enter", N_("change"), N_("Changes the selected setting; it is saved at once."),
           change, SETTINGS, 3, asks="text"),
    Action("setting_default", "delete,backspace", "Del", N_("default"), N_("Resets the selected setting."),
           default, SETTINGS, 5),
    Action("settings_defaults", "q_1", "Q1", N_("all defaults"), N_("Resets every setting; asks first."),
           all_defaults, SETTINGS),
)

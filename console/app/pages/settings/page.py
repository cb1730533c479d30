"""Shows the Settings screen: units, language, theme, sound, limits, rates, and every key. A change
is saved at once.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple

from rich.cells import cell_len
from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.content import Content
from textual.widgets import Static
from topdress.console.app import actions, themes
from topdress.console.app.action import ANYWHERE, SETTINGS, Action, make_bindings
from topdress.console.app.dialogs import Choice, ChoiceDialog, Dialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.job.checklist import find_file_name
from topdress.console.app.pages.settings.keys import ACTIONS
from topdress.console.app.pages.settings.service import SettingsStore
from topdress.console.app.panel_views import RunView
from topdress.console.app.settings import apply_settings, find_key_clash, find_keymap_fault
from topdress.console.app.typed_number import round_inwards
from topdress.console.app.undo_stack import UndoableChange
from topdress.console.app.units import Unit
from topdress.console.app.widgets.base_panel import (
    Picked,
    PickList,
    TextPart,
    choose_longest_fit,
    fit_text_width,
    make_line,
    wrap_text,
)
from topdress.console.locale import N_, _, list_languages
from topdress.drivers.files.settings import ManualRate, Presets, Rates, Settings


# The list shows as many settings around the marked line as fit. A click marks and changes a
# setting.
class SettingLine(NamedTuple):
    """Holds one setting. `group` is the heading before the first line of a group; `own` is True for
    a value other than the default."""

    group: str
    label: str
    value: str
    own: bool
    hint: str


class SettingsView(NamedTuple):
    """Holds the settings."""

    lines: tuple[SettingLine, ...]
    at: int
    # Path of the settings file.
    place: str
    # Reason why the file was not used.
    trouble: str


class SettingsList(PickList[SettingsView]):
    """Shows the settings."""

    def draw_rows(self, view: SettingsView, width: int, height: int) -> list[Content]:
        # Head and foot have fixed rows, and the list takes the rest.
        head = self._draw_head(view, width)
        label = max((cell_len(one.label) for one in view.lines), default=0) + 4
        # Values have at most a third of the width, because a long list of keys would displace the
        # hints.
        value = min(
            max((cell_len(one.value) for one in view.lines), default=0) + 3, max(12, width // 3)
        )
        rows = []
        foot = self._draw_foot(view, width)
        for index in self._choose_rows(view, height - len(head) - len(foot)):
            if isinstance(index, str):
                rows.append(make_line((fit_text_width(f" {index}", width), "bold $primary")))
                continue
            one = view.lines[index]
            # The mark has a sign and a colour.
            here = index == view.at
            style = "bold $on-select on $select" if here else "bold" if one.own else ""
            parts: list[TextPart] = [
                (fit_text_width(f" {'>' if here else ' '} {one.label}", label), style),
                (fit_text_width(f" {'*' if one.own else ' '}{one.value}", value), style or "bold"),
                (choose_longest_fit((f" {one.hint}", ""), width - label - value), "$muted"),
            ]
            rows.append(make_line(*parts))
        return [
            *head,
            *rows,
            *[make_line("")] * (height - len(head) - len(rows) - len(foot)),
            *foot,
        ]

    @staticmethod
    def _draw_head(view: SettingsView, width: int) -> list[Content]:
        """Return the rows with the file's path and the reason why it was not used."""
        place = choose_longest_fit((view.place, find_file_name(view.place)), width - 1)
        trouble = wrap_text(view.trouble, width - 4)
        return [
            make_line((f" {place}", "$muted")),
            *(
                make_line(
                    (
                        fit_text_width(f" {'!' if not k else ' '} {row}", width),
                        "bold $on-alarm-amber on $alarm-amber",
                    )
                )
                for k, row in enumerate(trouble)
            ),
        ]

    @staticmethod
    def _draw_foot(view: SettingsView, width: int) -> list[Content]:
        """Return the text of the marked setting in full. All settings take the same number of rows,
        so that the list does not jump."""
        # The longest hint determines the rows of the foot.
        count = max((len(wrap_text(one.hint, width - 2)) for one in view.lines), default=0)
        said = wrap_text(view.lines[view.at].hint, width - 2) if view.at < len(view.lines) else []
        return [make_line((f" {row}", "$muted")) for row in (said + [""] * count)[:count]]

    def _choose_rows(self, view: SettingsView, height: int) -> list[int | str]:
        """Return the visible lines (indices) and headings (texts), always including the marked
        line."""
        rows: list[int | str] = []
        group = None
        for index, one in enumerate(view.lines):
            # A heading precedes the first line of each group.
            if one.group != group:
                group = one.group
                rows.append(group)
            rows.append(index)
        at = rows.index(view.at) if view.at in rows else 0
        first = max(0, min(at - height // 2, len(rows) - height))
        return rows[first : first + max(0, height)]

    def list_row_items(self) -> Sequence[int | None]:
        width = self.content_size.width
        head, foot = len(self._draw_head(self.view, width)), len(self._draw_foot(self.view, width))
        rows = self._choose_rows(self.view, self.content_size.height - head - foot)
        return [*[None] * head, *(one if isinstance(one, int) else None for one in rows)]


# Words for the values in the settings file.
UNITS_NAMES = {"metric": N_("metric: km/h, kg/ha, ha"), "imperial": N_("imperial: mph, lb/ac, ac")}
LANGUAGE_NAMES = {"auto": N_("as the system says"), "en": "English", "zh": "中文"}
THEME_TITLES = {"day": N_("day"), "night": N_("night"), "contrast": N_("high contrast")}
SOUND_NAMES = {"on": N_("sound on"), "off": N_("sound off")}


class SettingRow(NamedTuple):
    """Describes a setting: label, value, and how it changes. `path` is its key in the settings."""

    group: str
    label: str
    path: tuple[str, ...]
    shown: str
    hint: str
    choices: tuple[Choice, ...] = ()
    # Lowest and highest value in displayed units, and the unit.
    number: tuple[float, float, Unit] | None = None


class SettingsScreen(Page):
    """Shows the settings."""

    where: ClassVar[str] = SETTINGS
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.at = 0
        self._writing = asyncio.Lock()
        # Settings in the file, once a change was made: a failed write returns to them.
        self._stored_settings: Settings | None = None

    @property
    def store(self) -> SettingsStore | None:
        """Store of the settings, or None where they are not saved."""
        return self.app.services.settings

    def compose_body(self) -> ComposeResult:
        yield SettingsList(SettingsView((), 0, "", ""), id="settings-list")

    def show_numbers(self, view: RunView) -> None:
        """Show the list."""
        super().show_numbers(view)
        if self.store is None:
            self.query_one("#settings-list", SettingsList).show_view(
                SettingsView((), 0, _("settings are not saved here"), "")
            )
            return
        default = Settings()
        lines = tuple(
            SettingLine(
                row.group,
                row.label,
                row.shown,
                _find_value(self.store.settings, row.path) != _find_value(default, row.path),
                row.hint,
            )
            for row in self.list_rows()
        )
        self.query_one("#settings-list", SettingsList).show_view(
            SettingsView(lines, self.at, self.store.place, self.store.trouble)
        )

    def list_rows(self) -> list[SettingRow]:
        """Return every setting in the language and units in use."""
        assert self.store is not None
        now, rate = self.store.settings, self.app.units.rate
        general, limits, speed = _("general"), _("manual rate"), _("how often the console looks")
        # Built-in themes come before those of the user's folder.
        themes_known = [
            Choice(name, _(THEME_TITLES.get(name, name)))
            for name in (*themes.THEME_NAMES, *(one.name for one in self.store.themes))
        ]
        found = [
            _make_choice_row(
                general, _("units"), ("units",), now.units, _make_choices(UNITS_NAMES), ""
            ),
            _make_choice_row(
                general,
                _("language"),
                ("language",),
                now.language,
                [
                    one
                    for one in _make_choices(LANGUAGE_NAMES)
                    if one.value in ("auto", *list_languages())
                ],
                "",
            ),
            _make_choice_row(
                general, _("theme"), ("theme",), now.theme, themes_known, _("D changes it for now")
            ),
            _make_choice_row(
                general,
                _("sound"),
                ("sound",),
                "on" if now.sound else "off",
                _make_choices(SOUND_NAMES),
                _("the bell: once for a caution, three times for an alarm"),
            ),
            _make_number_row(
                limits,
                _("lowest"),
                ("manual_rate", "low_kg_ha"),
                self.app.limits_kg_ha[0],
                # Each limit is bounded by the other limit, so that low never exceeds high.
                (self.app.crop_limits_kg_ha[0], self.app.limits_kg_ha[1]),
                rate,
            ),
            _make_number_row(
                limits,
                _("highest"),
                ("manual_rate", "high_kg_ha"),
                self.app.limits_kg_ha[1],
                (self.app.limits_kg_ha[0], self.app.crop_limits_kg_ha[1]),
                rate,
            ),
            *(
                _make_number_row(
                    _("preset rates"),
                    label,
                    ("presets", key),
                    getattr(now.presets, key),
                    self.app.limits_kg_ha,
                    rate,
                )
                for label, key in (
                    (_("preset 1"), "first_kg_ha"),
                    (_("preset 2"), "second_kg_ha"),
                    (_("preset 3"), "third_kg_ha"),
                )
            ),
            _make_number_row(
                speed,
                _("numbers"),
                ("console", "numbers_hz"),
                now.console.numbers_hz,
                (1.0, 5.0),
                _HERTZ,
            ),
            _make_number_row(
                speed, _("plots"), ("console", "plots_hz"), now.console.plots_hz, (0.2, 2.0), _HERTZ
            ),
            _make_number_row(
                speed, _("maps"), ("console", "maps_hz"), now.console.maps_hz, (0.1, 1.0), _HERTZ
            ),
        ]
        pages = {
            one.id.removesuffix("_screen"): _("keys: {page}").format(page=_(one.label))
            for one in actions.list_page_openers()
        }
        # Keys of every screen come first, then the pages in the order of their keys.
        groups = {ANYWHERE: _("keys of every screen")} | pages
        # Keys are grouped by page, in the order of the pages' keys.
        for action in sorted(actions.ACTIONS, key=lambda one: list(groups).index(one.where)):
            keys = actions.find_keys(action, now.keymap)
            found.append(
                SettingRow(
                    groups[action.where],
                    _(action.label),
                    ("keymap", action.id),
                    "  ".join(actions.format_key(key) for key in keys),
                    _(action.help),
                )
            )
        return found

    # The following methods perform the actions of the page.

    def perform_action(self, action: Action) -> None:
        if self.store is None:
            self.app.show_notice(_("settings are not saved here"))
            return
        super().perform_action(action)

    def move_mark(self, by: int) -> None:
        """Move the mark."""
        self.at = max(0, min(len(self.list_rows()) - 1, self.at + by))

    def on_picked(self, event: Picked) -> None:
        """Mark and change the clicked setting."""
        self.at = event.index
        self.app.show_changes()
        if self.app.locked:
            self.app.show_notice(_("locked: F8 unlocks; hold and stop work"))
        else:
            self.change_marked()

    def change_marked(self) -> None:
        """Ask for a new value of the marked setting."""
        assert self.store is not None
        row, now = self.list_rows()[self.at], self.store.settings
        if row.choices:
            value = _find_value(now, row.path)
            value = (
                # The file has a boolean, the list has words.
                {True: "on", False: "off"}.get(value, value) if isinstance(value, bool) else value
            )
            # A theme is previewed while it is chosen.
            kind = ThemeDialog if row.path == ("theme",) else ChoiceDialog
            self.app.ask_question(
                kind(row.label, row.choices, str(value)),
                lambda value: self._set_value(
                    row.path, value == "on" if row.path == ("sound",) else value
                ),
            )
        elif row.number is not None:
            low, high, unit = row.number
            self.app.ask_question(
                NumberDialog(
                    f"{row.group}: {row.label}", unit.name, low, high, to_si=unit.convert_to_si
                ),
                lambda value: self._set_value(row.path, round(value, 3)),
            )
        else:
            self.app.ask_question(
                KeyPressDialog(row.label, row.shown), lambda key: self._assign_key(row.path[1], key)
            )

    def _assign_key(self, name: str, key: str) -> None:
        """Assign a key to an action, if it is free."""
        assert self.store is not None
        keymap = {**self.store.settings.keymap, name: key}
        self._set_keymap(keymap, find_keymap_fault({name: key}) or find_key_clash(keymap))

    def _set_keymap(self, keymap: dict[str, str], trouble: str) -> None:
        """Use a keymap, or report why it is refused."""
        if trouble:
            self.app.show_notice(_("refused: {why}").format(why=trouble))
        else:
            self._set_value(("keymap",), keymap)

    def reset_marked(self) -> None:
        """Reset the marked setting."""
        assert self.store is not None
        path = self.list_rows()[self.at].path
        if path[0] != "keymap":
            self._set_value(path, _find_value(Settings(), path))
            return
        keymap = {
            name: keys for name, keys in self.store.settings.keymap.items() if name != path[1]
        }
        # The default key may meanwhile belong to another action.
        self._set_keymap(keymap, find_key_clash(keymap))

    def _set_value(self, path: tuple[str, ...], value: Any) -> None:
        """Set a value by its path; an invalid value is reported."""
        assert self.store is not None
        now = self.store.settings
        try:
            if path[0] == "manual_rate":
                # pydantic checks the whole group, because its values depend on each other.
                value = ManualRate.model_validate(now.manual_rate.model_dump() | {path[1]: value})
            elif path[0] == "presets":
                value = Presets.model_validate(now.presets.model_dump() | {path[1]: value})
            elif path[0] == "console":
                value = Rates.model_validate(now.console.model_dump() | {path[1]: value})
            self.use_settings(now.model_copy(update={path[0]: value}))
        except ValueError as error:
            self.app.show_notice(str(error).splitlines()[-1])

    def use_settings(self, settings: Settings) -> None:
        """Use settings from now on, and save them."""
        store = self.store
        assert store is not None
        before = store.settings
        # Settings take effect before they are written: a full disk must not prevent them.
        store.settings, store.trouble = settings, apply_settings(self.app, settings)
        if before != settings:
            self.app.undo.add_change(
                UndoableChange(
                    _("settings before the last change"), partial(self.use_settings, before)
                )
            )
        # Writes are asynchronous: the settings before the first unsaved change are those of the
        # file.
        self._stored_settings = self._stored_settings or before
        self.app.run_worker(self._write_settings(settings), group="settings", exit_on_error=False)
        self._redraw_pages()

    async def _write_settings(self, settings: Settings) -> None:
        """Write settings in a thread, one write after the other, because a disk may be slow. After
        a failure the file's settings are used again."""
        store = self.store
        assert store is not None and self._stored_settings is not None
        try:
            # Two writes at once could leave the older settings in the file.
            async with self._writing:
                await asyncio.to_thread(store.write, settings)
                self._stored_settings = settings
        except OSError as error:
            store.settings = self._stored_settings
            apply_settings(self.app, self._stored_settings)
            store.trouble = _("not kept: {why}").format(
                why=f"{store.place}: {error.strerror or error}"
            )
            self.app.show_notice(store.trouble)
            self._redraw_pages()

    def _redraw_pages(self) -> None:
        """Draw every page again."""
        for page in self.app.pages.made.values():
            if page.is_mounted:
                page.redraw_all()
        self.app.show_changes()


class ThemeDialog(ChoiceDialog):
    """Asks for a theme. The marked theme is applied at once; Escape restores the former theme."""

    def _show_mark(self) -> None:
        super()._show_mark()
        self._apply_theme(self.choices[self.at].value)

    def action_cancel(self) -> None:
        """Restore the former theme."""
        self._apply_theme(self.now)
        super().action_cancel()

    def _apply_theme(self, name: str) -> None:
        """Apply a theme if it is registered."""
        # A theme of the file may be missing on this computer.
        if name in self.app.available_themes:
            self.app.theme = name


class KeyPressDialog(Dialog[str | None]):
    """Asks for the next key that is pressed; Escape keeps the former key."""

    def __init__(self, label: str, now: str) -> None:
        super().__init__(
            _("Press a key for: {action}").format(action=label), _("now: {keys}").format(keys=now)
        )
        self.key = ""

    BINDINGS: ClassVar = [
        Binding("escape", "cancel", show=False),
        Binding("enter", "yes", show=False),
    ]

    def compose_body(self) -> ComposeResult:
        yield Static("_", classes="dialog-value", id="key-value", markup=False)

    def describe_yes(self) -> str:
        return _("take it")

    def on_key(self, event: events.Key) -> None:
        """Show the pressed key."""
        if event.key in ("escape", "enter"):
            return
        event.stop()
        # Without this, Textual would run the pressed key's own action.
        event.prevent_default()
        self.key = event.key
        self.query_one("#key-value", Static).update(actions.format_key(event.key))

    def action_yes(self) -> None:
        """Answer with the key."""
        if self.key:
            self.dismiss(self.key)


_HERTZ = Unit("Hz", 1.0, 1)


def _make_choices(words: dict[str, str]) -> list[Choice]:
    """Return choices with translated words."""
    return [Choice(value, _(word)) for value, word in words.items()]


def _make_choice_row(
    group: str, label: str, path: tuple[str, ...], now: str, choices: list[Choice], hint: str
) -> SettingRow:
    """Return a row for a setting with fixed choices."""
    shown = next((one.label for one in choices if one.value == now), now)
    return SettingRow(group, label, path, shown, hint, tuple(choices))


def _make_number_row(
    group: str,
    label: str,
    path: tuple[str, ...],
    now: float,
    allowed: tuple[float, float],
    unit: Unit,
) -> SettingRow:
    """Return a row for a number, with its allowed range in displayed units."""
    low, high = round_inwards(unit, *allowed, 1)
    said = _("allowed: {low} to {high} {unit}").format(
        low=f"{low:g}", high=f"{high:g}", unit=unit.name
    )
    return SettingRow(
        group,
        label,
        path,
        f"{now * unit.per_si:g} {unit.name}" if unit is _HERTZ else unit.format_with_name(now),
        said,
        number=(low, high, unit),
    )


def _find_value(settings: Settings, path: tuple[str, ...]) -> Any:
    """Return the value at a path of the settings."""
    value: Any = settings
    for step in path:
        value = value.get(step) if isinstance(value, dict) else getattr(value, step)
    return value

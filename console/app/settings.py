"""Checks the user's settings for the console and applies them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING

from textual.theme import Theme
from topdress.console.app import actions, themes
from topdress.console.app.action import ANYWHERE
from topdress.console.app.alarms import STROKES_BY_SEVERITY
from topdress.console.app.key_normaliser import STOP_KEY
from topdress.console.app.units import UNITS
from topdress.console.locale import _, find_preferred_language, use_language
from topdress.control.orders import Severity
from topdress.drivers.files.settings import ManualRate, Settings
from topdress.drivers.files.user_themes import ThemeData

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp

# Keys that dialogs need.
RESERVED_KEYS = frozenset({"escape", "enter", "tab", "shift+tab"})
# A capital letter, or Textual's name of a key with its modifiers.
_KEY_PATTERN = re.compile(r"[A-Z]|[a-z0-9_]+(\+[a-z0-9_]+)*")

# Maps colours of a theme file to the variables of the style sheets.
_THEME_VARIABLES = {
    "red": "alarm-red",
    "on-red": "on-alarm-red",
    "amber": "alarm-amber",
    "on-amber": "on-alarm-amber",
    "keybar": "keybar",
    "on-keybar": "on-keybar",
    "keybar-key": "keybar-key",
    "stale": "stale",
    "muted": "muted",
    "target": "target",
}
# Colours of a theme file that Textual itself has as fields.
_THEME_FIELDS = ("background", "surface", "panel", "foreground", "primary")


def find_keymap_fault(keymap: Mapping[str, str]) -> str:
    """Return the first fault of a keymap in one line; "" for a valid keymap."""
    for name, keys in keymap.items():
        action = actions.BY_ID.get(name)
        if action is None:
            return _("key keymap.{name}: no such action").format(name=name)
        for key in (key.strip() for key in keys.split(",")):
            if key.rpartition("+")[2] == STOP_KEY and name != "stop":
                return _("key keymap.{name}: value {key}: F12 is STOP on every screen").format(
                    name=name, key=key
                )
            if key in RESERVED_KEYS or not _KEY_PATTERN.fullmatch(key):
                return _("key keymap.{name}: value {key}: not a key that can be used").format(
                    name=name, key=key
                )
    return find_key_clash(keymap)


def find_key_clash(keymap: Mapping[str, str]) -> str:
    """Return one line about two actions of one screen on the same key; "" without a clash."""
    for one, other in combinations(actions.ACTIONS, 2):
        if one.where == other.where or ANYWHERE in (one.where, other.where):
            both = set(actions.find_keys(one, keymap)) & set(actions.find_keys(other, keymap))
            # Two built-in keys cannot clash, so only changed keys are reported.
            if both and (one.id in keymap or other.id in keymap):
                return _("key {key}: both {one} and {other}").format(
                    key=min(both), one=_(one.label), other=_(other.label)
                )
    return ""


def make_theme(data: ThemeData) -> Theme:
    """Convert a theme file to a Textual theme: one of the built-in themes with other colours."""
    like = {theme.name: theme for theme in themes.THEMES}[data.like]
    own = {name: data.colours.get(name, getattr(like, name)) for name in _THEME_FIELDS}
    variables = dict(like.variables)
    for name, colour in data.colours.items():
        if name in _THEME_VARIABLES:
            variables[_THEME_VARIABLES[name]] = colour
    variables["applied"] = data.colours.get("foreground", like.variables["applied"])
    return Theme(
        name=data.name,
        dark=like.dark if data.dark is None else data.dark,
        **own,
        secondary=variables["target"],
        accent=own["primary"],
        warning=variables["alarm-amber"],
        error=variables["alarm-red"],
        success=variables["target"],
        boost=own["surface"],
        text_alpha=like.text_alpha,
        variables=variables,
    )


def apply_settings(app: TopdressApp, settings: Settings) -> str:
    """Apply the settings now. Returns one line about settings that cannot be used; "" where all
    can."""
    trouble = find_keymap_fault(settings.keymap)
    app.units = UNITS[settings.units]
    use_language(find_preferred_language() if settings.language == "auto" else settings.language)
    if settings.theme in app.available_themes:
        app.theme = settings.theme
    else:
        known = ", ".join(themes.THEME_NAMES)
        trouble = trouble or _("key theme: value {name}: allowed {known}").format(
            name=settings.theme, known=known
        )
    # A faulty keymap is ignored as a whole, because a part of it could be ambiguous.
    app.use_keymap({} if trouble and find_keymap_fault(settings.keymap) else settings.keymap)
    app.sound = settings.sound
    app.sounds = {
        STROKES_BY_SEVERITY[Severity.RED]: settings.sounds.alarm,
        STROKES_BY_SEVERITY[Severity.AMBER]: settings.sounds.caution,
    }
    set_rate_limits(app, settings.manual_rate)
    presets = settings.presets
    app.presets_kg_ha = presets.first_kg_ha, presets.second_kg_ha, presets.third_kg_ha
    app.rates = settings.console
    for page in app.pages.made.values():
        app.set_refresh_rates(page)
    return trouble


def set_rate_limits(app: TopdressApp, own: ManualRate | None) -> None:
    """Set the range of a manual rate: the crop's, narrowed by the settings."""
    low, high = app.crop_limits_kg_ha
    if own is not None:
        low, high = min(max(low, own.low_kg_ha), high), min(high, own.high_kg_ha)
    app.limits_kg_ha = low, high

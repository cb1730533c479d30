"""How are the user's settings for the console stored? They are read once, and written when the
Settings screen changes them.
"""

from __future__ import annotations

from topdress.console.app.pages.settings.service import SettingsStore
from topdress.drivers.files.settings import find_settings_path, read_settings, write_settings
from topdress.drivers.files.user_themes import read_themes


def read_settings_store() -> SettingsStore:
    """Returns the user's settings. Never raises: the store reports a broken file, and does not
    change it."""
    path = find_settings_path()
    read = read_settings(path)
    themes, wrong = read_themes(path.parent / "themes")
    return SettingsStore(
        read.settings,
        lambda settings: write_settings(path, settings),
        str(path),
        read.trouble or (wrong[0] if wrong else ""),
        themes,
    )

"""What the Settings page is given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from topdress.drivers.files.settings import Settings
from topdress.drivers.files.settings_theme import ThemeData


@dataclass(slots=True)
class SettingsStore:
    """Holds the settings and where they are kept. trouble: why the file was not used. write: raises
    OSError."""

    settings: Settings
    write: Callable[[Settings], None]
    place: str = ""
    trouble: str = ""
    themes: tuple[ThemeData, ...] = ()

"""Declares the store of the user's settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from topdress.drivers.files.settings import Settings
from topdress.drivers.files.user_themes import ThemeData


@dataclass(slots=True)
class SettingsStore:
    """Holds the settings and the path of their file.

    Attributes
    ----------
    settings
        Settings in force.
    write
        Writes settings; raises OSError.
    place
        Path of the file.
    trouble
        Reason why the file was not used.
    """

    settings: Settings
    write: Callable[[Settings], None]
    place: str = ""
    trouble: str = ""
    themes: tuple[ThemeData, ...] = ()

"""One action: its key, its words, and the screen that it belongs to."""
from __future__ import annotations

from typing import NamedTuple

ANYWHERE = "anywhere"
RUN, MAP, TRENDS, DEVICES, CALIBRATE = "run", "map", "trends", "devices", "calibrate"
REPLAY, DIAGNOSIS, JOB, SETTINGS = "replay", "diagnosis", "job", "settings"


class Action(NamedTuple):
    """id: also the key for a keymap. bar: place in the key bar, 0 = not there. locked: still works in lock mode."""

    id: str
    keys: str
    shown: str
    label: str
    help: str
    where: str = ANYWHERE
    bar: int = 0
    locked: bool = False
    priority: bool = False

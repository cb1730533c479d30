"""All pages of the console, by the word that their actions carry."""
from __future__ import annotations

from console.app.action import REPLAY, RUN
from console.app.replay_job import ReplayJob
from console.app.screens.page import Page
from console.app.screens.replay import ReplayScreen
from console.app.screens.run import RunScreen


def all_pages(replay: ReplayJob | None) -> dict[str, Page]:
    """One of each. They are composed when they are first turned to."""
    return {RUN: RunScreen(), REPLAY: ReplayScreen(replay)}

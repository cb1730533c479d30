"""Maps the name of a page to the page; a page is imported and built on first use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from types import ModuleType

from topdress.console.app.action import (
    CALIBRATE,
    DEVICES,
    DIAGNOSIS,
    JOB,
    MAP,
    REPLAY,
    RUN,
    SETTINGS,
    TRENDS,
)
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.services import Services

# Class names as text, because importing all pages at the start would delay the first picture.
SCREEN_CLASSES = {
    RUN: "RunScreen",
    MAP: "MapScreen",
    TRENDS: "TrendsScreen",
    DEVICES: "DevicesScreen",
    CALIBRATE: "CalibrateScreen",
    REPLAY: "ReplayScreen",
    DIAGNOSIS: "DiagnosisScreen",
    JOB: "JobScreen",
    SETTINGS: "SettingsScreen",
}


class Pages(Mapping[str, Page]):
    """Maps names to pages, one of each. Textual composes a page when it is first opened.

    Parameters
    ----------
    begin
        Receives every page that was built.
    """

    def __init__(
        self, replay: ReplayJob | None, services: Services, begin: Callable[[str, Page], None]
    ) -> None:
        # Arguments of the pages whose constructor has any.
        self._needs: dict[str, tuple[object, ...]] = {
            CALIBRATE: (services.calibrate,),
            REPLAY: (replay,),
        }
        self._begin = begin
        self.made: dict[str, Page] = {}

    def __getitem__(self, where: str) -> Page:
        if where not in self.made:
            screen = getattr(self.import_page(where), SCREEN_CLASSES[where])
            self.made[where] = screen(*self._needs.get(where, ()))
            self._begin(where, self.made[where])
        return self.made[where]

    def __contains__(self, where: object) -> bool:
        return where in SCREEN_CLASSES

    def __iter__(self) -> Iterator[str]:
        return iter(SCREEN_CLASSES)

    def __len__(self) -> int:
        return len(SCREEN_CLASSES)

    @staticmethod
    def import_page(where: str) -> ModuleType:
        """Import a page's modules without building the page; this may run in a thread, because a
        disk may be slow."""
        return import_module(f"topdress.console.app.pages.{where}.page")

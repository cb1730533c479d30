"""The file that is laid on the map, read along with the screen, and again where another job has another plane."""
from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from console.app.laid import LaidFile
from console.frame import Frame
from console.locale import _

if TYPE_CHECKING:
    from console.app.pages.page import Page

NEAR_M = 500.0           # further from the field or the machine, and it is said
M_PER_KM = 1000.0


class LaidFiles:
    """path: of the file that is wanted, "": none. A file that cannot be laid is said once and not wanted any more."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.path = ""
        self._asked: tuple[str, str, str] | None = None
        self._laid: LaidFile | None = None

    def want(self, path: str) -> None:
        self.path, self._asked, self._laid = path, None, None

    def of(self, frame: Frame | None) -> LaidFile | None:
        """The wanted file on a frame's plane; asked for the first time, it is read and comes later."""
        files = self._page.app.services.layers
        if not self.path or files is None or frame is None or frame.place_m is None:
            return None
        key = (self.path, frame.log_path, frame.job)
        if key != self._asked:
            self._asked, self._laid = key, None
            self._page.app.with_files(partial(files.lay, self.path, frame), partial(self._have, key),
                                      partial(self._not_laid, key), group="laid")
        return self._laid

    def _not_laid(self, key: tuple[str, str, str], why: str) -> None:
        if key == self._asked:
            self.want("")
            self._page.app.notice(why)

    def _have(self, key: tuple[str, str, str], laid: LaidFile) -> None:
        if key != self._asked:
            return
        self._laid = laid
        if laid.apart_m > NEAR_M:
            self._page.app.notice(_("{name} lies {distance} km from here").format(
                name=laid.name, distance=f"{laid.apart_m / M_PER_KM:.1f}"))
        self._page.hurry()

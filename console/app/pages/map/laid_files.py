"""The file that is laid on the map, read along with the screen, and again where another job has another plane."""
from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Protocol

from console.app.laid import LaidFile
from console.app.pages.replay.log_files import LogFile
from console.frame import Frame
from console.locale import _


class LayerFiles(Protocol):
    """Errors are one-line ValueErrors."""

    def files(self, running_log: str) -> tuple[LogFile, ...]:
        """The newest first, without the log that is being written."""

    def lay(self, path: str, frame: Frame) -> LaidFile:
        """Reads a file onto the plane of a frame that has a position; seconds for a long one."""


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
            self._page.app.run_worker(self._bring(key, frame, files), group="laid", exit_on_error=False)
        return self._laid

    async def _bring(self, key: tuple[str, str, str], frame: Frame, files: LayerFiles) -> None:
        try:
            laid = await asyncio.to_thread(files.lay, self.path, frame)
        except ValueError as error:
            if key == self._asked:
                self.want("")
                self._page.app.notice(str(error))
            return
        if key != self._asked:
            return
        self._laid = laid
        if laid.apart_m > NEAR_M:
            self._page.app.notice(_("{name} lies {distance} km from here").format(
                name=laid.name, distance=f"{laid.apart_m / M_PER_KM:.1f}"))
        self._page.hurry()

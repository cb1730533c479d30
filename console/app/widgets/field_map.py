"""Shows a map that changes continuously; only changed rows are drawn again."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt
from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from topdress.console.app.map_camera import PixelGrid
from topdress.console.app.map_image import Codes
from topdress.console.app.map_ink import MapInk, MapView, make_cell_codes
from topdress.console.app.terminal import has_few_colours
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.locale import _


class FieldMap(Canvas[MapView]):
    """Shows a map that changes continuously."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"map--muted"}

    def __init__(self, view: MapView, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(view, id=id, classes=classes)
        self._codes: Codes | None = None
        self._drawn: list[Strip] = []
        self._ink: MapInk
        # A segment is made once per code: most cells repeat.
        self._segments: dict[int, Segment] = {}
        self._ink_key: object = None
        # Tests check by this count that unchanged rows are not drawn.
        self.rows_drawn = 0

    def make_grid(self) -> PixelGrid:
        """Return the visible ground at the widget's size."""
        width, height = self.content_size
        return self.view.camera.make_grid(width, 2 * height)

    def _find_changed_rows(self) -> list[int]:
        # Without strips the whole map is drawn.
        return self._update_strips(*self.content_size) if self._drawn else []

    def draw_rows(self, view: MapView, width: int, height: int) -> list[Strip]:
        self._codes, self._drawn = None, []
        if width > 0 and height > 0:
            self._update_strips(width, height)
        return self._drawn

    def _update_strips(self, width: int, height: int) -> list[int]:
        """Make the strips of changed rows and return their indices."""
        self._update_ink()
        found = make_cell_codes(self.view, self.make_grid())
        old = self._codes
        # Another size makes every row new.
        fresh = old is None or old.shape != found.shape or len(self._drawn) != height
        changed = (
            list(range(height))
            if fresh or old is None
            # Comparing codes is far cheaper than making segments for every cell.
            else np.flatnonzero((found != old).any(axis=1)).tolist()
        )
        if fresh:
            self._drawn = [Strip.blank(width)] * height
        for row in changed:
            self._drawn[row] = self._make_strip(found[row], width)
        self._codes = found
        self.rows_drawn += len(changed)
        view = self.view
        if (
            view.place is None
            and view.worked.box is None
            and (view.picture is None or view.picture.box is None)
        ):
            self._drawn[height // 2] = self.make_text_strip(
                width, (f" {_('no position yet')}", self.find_style("map--muted"))
            )
            changed = list(range(height))
        return changed

    def _make_strip(self, row: npt.NDArray[np.int32], width: int) -> Strip:
        """Return a row as segments; equal neighbours share a segment."""
        # Runs of equal codes become one segment.
        begins = np.concatenate(([0], np.flatnonzero(np.diff(row)) + 1, [width]))
        segments = []
        for begin, end in zip(begins[:-1].tolist(), begins[1:].tolist(), strict=True):
            code = int(row[begin])
            one = self._segments.get(code)
            if one is None:
                one = self._segments[code] = self._make_segment(code)
            segments.append(
                one if end - begin == 1 else Segment(one.text * (end - begin), one.style)
            )
        return Strip(segments, width)

    def _update_ink(self) -> None:
        """Drop the cached segments when the colours have changed."""
        laid = self.view.laid.scale if self.view.laid is not None else None
        # Everything on which colours depend; the numbers of the scale change the codes instead.
        wanted = (
            self.view.scale.layer,
            laid and laid.layer,
            self.app.theme,
            self.view.stale,
            has_few_colours(self.app),
        )
        if wanted != self._ink_key:
            self._ink_key = wanted
            self._segments.clear()
            self._codes = None
            self._ink = MapInk(self, self.view.scale, laid, self.view.stale)

    def _make_segment(self, code: int) -> Segment:
        """Return the segment of a code."""
        text, fore, back = self._ink.draw_cell(code)
        return Segment(
            text,
            self.rich_style
            + Style(
                color=Color.from_rgb(*fore) if fore else None,
                bgcolor=Color.from_rgb(*back) if back else None,
            ),
        )

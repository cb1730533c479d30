"""Loads the file that is overlaid on the map, and shows its legend in one row."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from topdress.console.app.overlay_file import OverlayFile
from topdress.console.frame import Frame
from topdress.console.locale import _

if TYPE_CHECKING:
    from topdress.console.app.pages.base_page import Page

from typing import ClassVar, NamedTuple

from rich.cells import cell_len
from textual.strip import Strip
from topdress.console.app.map_ink import (
    ERROR_LEVEL_SIGNS,
    OVERLAY_COLOUR_SHARE,
    OVERLAY_LEVEL_SIGNS,
)
from topdress.console.app.map_layers import LAYER_LABELS, LayerScale, MapLayer
from topdress.console.app.widgets.base_panel import fit_text_width
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.app.widgets.map_legend import draw_colour_ramp

# The file is read in a thread, and again where another job has another plane. Beyond this distance
# from the field or machine, m, the distance is reported.
REPORTED_DISTANCE_M = 500.0
M_PER_KM = 1000.0


class OverlayLoader:
    """Loads the overlaid file. A file that cannot be overlaid is reported once and then no longer
    requested."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.path = ""
        self._asked: tuple[str, str, str] | None = None
        self._laid: OverlayFile | None = None

    def request_file(self, path: str) -> None:
        """Request another file, or none with ""."""
        self.path, self._asked, self._laid = path, None, None

    def find_overlay(self, frame: Frame | None) -> OverlayFile | None:
        """Return the requested file on a frame's plane. The first call starts the load and returns
        None."""
        files = self._page.app.services.layers
        if not self.path or files is None or frame is None or frame.place_m is None:
            return None
        key = (self.path, frame.log_path, frame.job)
        if key != self._asked:
            self._asked, self._laid = key, None
            self._page.app.run_with_files(
                partial(files.make_overlay, self.path, frame),
                partial(self._take_overlay, key),
                partial(self._note_failure, key),
                group="laid",
            )
        return self._laid

    def _note_failure(self, key: tuple[str, str, str], why: str) -> None:
        """Report a failed load, unless another file was requested meanwhile."""
        if key == self._asked:
            self.request_file("")
            self._page.app.show_notice(why)

    def _take_overlay(self, key: tuple[str, str, str], laid: OverlayFile) -> None:
        """Store the loaded file, unless another file was requested meanwhile."""
        if key != self._asked:
            return
        self._laid = laid
        if laid.apart_m > REPORTED_DISTANCE_M:
            self._page.app.show_notice(
                _("{name} lies {distance} km from here").format(
                    name=laid.name, distance=f"{laid.apart_m / M_PER_KM:.1f}"
                )
            )
        self._page.refresh_all_next_tick()


# Limits of the width of the colour ramp, in cells.
_MIN_RAMP_CELLS, _MAX_RAMP_CELLS = 4, 24


class OverlayLegendView(NamedTuple):
    """Holds the legend; where `scale` is None, the text `said` replaces it."""

    name: str
    label: str
    scale: LayerScale | None
    said: str


class OverlayLegend(Canvas[OverlayLegendView]):
    """Shows the legend."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"map--muted"}

    def draw_rows(self, view: OverlayLegendView, width: int, height: int) -> list[Strip]:
        muted = self.find_style("map--muted")
        name = f" {_('file')} {view.name}: "
        if view.scale is None:
            name = fit_text_width(name, min(cell_len(name), max(0, width - cell_len(view.said))))
            return [self.make_text_strip(width, (name, self.rich_style), (view.said, muted))]
        scale = view.scale
        unit = f" {scale.unit}" if scale.unit else ""
        low, high = (
            f"{view.label} {scale.format_value(scale.low)} ",
            f" {scale.format_value(scale.high)}{unit}",
        )
        room = width - sum(map(cell_len, (low, high)))
        # The name of the file is shortened before the ramp disappears.
        name = fit_text_width(name, min(cell_len(name), max(0, room - _MIN_RAMP_CELLS)))
        cells = max(_MIN_RAMP_CELLS, min(_MAX_RAMP_CELLS, room - cell_len(name)))
        levels = ERROR_LEVEL_SIGNS if scale.layer is MapLayer.ERROR else OVERLAY_LEVEL_SIGNS
        return [
            self.make_text_strip(
                width,
                (name, self.rich_style),
                (low, muted),
                *draw_colour_ramp(self, scale, cells, levels, OVERLAY_COLOUR_SHARE),
                (high, muted),
            )
        ]


def find_overlay_label(scale: LayerScale | None, harvest: str) -> str:
    """Return the word for the file's numbers: the layer's, or its harvest."""
    return harvest if harvest or scale is None else _(LAYER_LABELS[scale.layer])

"""One row on the Run page: how far the machine is off the A-B line, as lights to either side. It does not steer."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content

from console.app.guide_line import GuideLine
from console.app.units import Units
from console.app.view import Shown
from console.app.widgets.panel import Panel, Part, fullest, line
from console.frame import Frame
from console.locale import _

LIGHT_M = 0.1           # of each light: a tenth of a metre, as the light bars of other makers are set at first
LIGHTS = 8              # to either side
LIT, DARK = "█", "·"


class LightView(NamedTuple):
    """lights: to the left negative, to the right positive, 0: on the line. said: the distance off it in words."""

    lights: int
    said: Shown
    track: str


def light_view(guide: GuideLine, frame: Frame | None, stale: bool, units: Units) -> LightView | None:
    """None while there is no line, or no place to hold against it."""
    if frame is None or frame.place_m is None:
        return None
    off = guide.off(frame.place_m, frame.row.heading_deg)
    if off is None:
        return None
    near = units.fine_distance._replace(decimals=2 if units.id == "metric" else 1)
    lights = max(-LIGHTS, min(LIGHTS, round(off.right_m / LIGHT_M)))
    text = near.full(abs(off.right_m))
    said = (_("{distance} right of the line") if lights > 0 else _("{distance} left of the line") if lights < 0 else
            _("on the line, {distance}")).format(distance=text)
    return LightView(lights, Shown(said, stale), _("track {number}").format(number=f"{off.number:+d}" if off.number
                                                                          else "A-B"))


class LightBar(Panel[LightView | None]):
    """Lights stand on the side where the machine is: steer away from them."""

    def lines(self, view: LightView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        left = DARK * (LIGHTS + min(0, view.lights)) + LIT * max(0, -view.lights)
        after = LIT * max(0, view.lights) + DARK * (LIGHTS - max(0, view.lights))
        lit = "$stale" if view.said.stale else "$alarm-amber" if view.lights else "$target"
        middle: Part = (" ◆ " if not view.lights else " ┃ ", f"bold {lit}")
        bar = 2 * LIGHTS + 3
        text = f" {view.said.text}"
        track = fullest((f"{view.track} ", ""), width - bar - cell_len(text) - 2)
        gap = " " * max(0, width - bar - cell_len(text) - cell_len(track) - 1)
        return [line(" ", (left, f"bold {lit}"), middle, (after, f"bold {lit}"),
                     (text, "$stale" if view.said.stale else "bold"), gap, (track, "$muted"))]

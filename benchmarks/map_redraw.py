"""How long the map takes to draw: 250,000 planned cells, 100,000 applied points, two sizes of terminal.

`python benchmarks/map_redraw.py`: medians in ms of process time, of the whole field and of a near view. Full: every row
anew, as after a zoom. One second on: five more points entered (5 frames a second) and the rows that changed drawn.
"""
from __future__ import annotations

import asyncio
import statistics
import sys
import time
from collections.abc import Callable
from math import sin

import numpy as np
from textual.app import App, ComposeResult
from verdict import exit_code

from console.app import themes
from console.app.camera import Camera, fit
from console.app.field_picture import FieldPicture, Planned
from console.app.layers import Layer, scale_of
from console.app.units import METRIC
from console.app.widgets.field_map import FieldMap, MapView
from console.app.worked import Spot, Worked

POINTS, STEP_M, PASS_M, WIDTH_M = 100_000, 0.8, 480.0, 2.4
REPEATS = 15


def driven(count: int) -> list[Spot]:
    """Up and down side by side."""
    spots = []
    for k in range(count):
        lap, along = divmod(k * STEP_M, PASS_M)
        up = int(lap) % 2 == 0
        north = along if up else PASS_M - along
        spots.append(Spot(WIDTH_M * lap, north, 0.0 if up else 180.0, 300.0 + 60.0 * sin(north / 23.0 + lap / 7.0),
                          300.0 + 50.0 * sin(north / 23.0), 0.5 + 0.05 * sin(north / 31.0)))
    return spots


def field() -> FieldPicture:
    rates = np.random.default_rng(1).choice([180.0, 240.0, 300.0, 360.0], (500, 500)).astype(np.float32)
    corners = ((-5.0, -5.0), (495.0, -5.0), (495.0, 490.0), (-5.0, 490.0))
    return FieldPicture("", (corners,), 24.75, WIDTH_M, Planned(-5.0, -10.0, 1.0, rates))


class OneMap(App[None]):
    CSS = ("FieldMap { width: 100%; height: 100%; background: $background; color: $foreground; } "
           "FieldMap .map--passage { color: $track; } FieldMap .map--outline { color: $muted; } "
           "FieldMap .map--tractor { color: $background; background: $foreground; }")

    def __init__(self, view: MapView) -> None:
        super().__init__()
        self.map = FieldMap(view)
        for theme in themes.THEMES:
            self.register_theme(theme)
        self.theme = "day"

    def compose(self) -> ComposeResult:
        yield self.map


def median_ms(do: Callable[[], None]) -> float:
    took = []
    for _repeat in range(REPEATS):
        begun = time.process_time()
        do()
        took.append(1000.0 * (time.process_time() - begun))
    return statistics.median(took)


async def measure(size: tuple[int, int], near: bool) -> float:
    """Prints a row; how many rows of the map were drawn anew after a second on, in the mean."""
    spots = driven(POINTS + 5 * REPEATS + 5)
    worked, picture = Worked(WIDTH_M), field()
    for begin in range(0, POINTS, 10_000):
        worked.add(spots[begin:begin + 10_000])
    at = POINTS
    last = spots[at]
    pixels = (size[0], 2 * size[1])
    camera = Camera(last.east_m, last.north_m, 0.5) if near else fit(picture.box, *pixels)

    def view() -> MapView:
        here = spots[at]
        return MapView(worked, worked.version, picture, scale_of(Layer.APPLIED, worked, picture, METRIC), camera,
                       (here.east_m, here.north_m), here.heading_deg)

    app = OneMap(view())
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        drawn = app.map

        def rows() -> None:
            for row in range(size[1]):
                drawn.render_line(row)

        def full() -> None:
            drawn.repaint()
            rows()

        full_ms = median_ms(full)
        rows_before = drawn.rows_drawn

        def second_on() -> None:
            nonlocal at
            worked.add(spots[at:at + 5])
            at += 5
            drawn.show(view())

        next_ms = median_ms(second_on)
        changed = (drawn.rows_drawn - rows_before) / REPEATS
        screen_ms = median_ms(lambda: app.screen._compositor.render_strips())
        print(f"{size[0]:>3} x {size[1]:<3} {'near' if near else 'whole':>5} {camera.metres:>7.2f} {full_ms:>9.1f} "
              f"{next_ms:>10.2f} {changed:>9.1f} {screen_ms:>12.1f}")
        return changed


def main() -> int:
    begun = time.process_time()
    worked = Worked(WIDTH_M)
    spots = driven(POINTS)
    made = time.process_time()
    for begin in range(0, POINTS, 10_000):
        worked.add(spots[begin:begin + 10_000])
    entered = time.process_time()
    for spot in driven(POINTS + 1000)[POINTS:]:
        worked.add([spot])
    one = time.process_time()
    tiles = worked.tiles
    print(f"entered: {POINTS} points in {1000 * (entered - made):.0f} ms in slices of 10,000; one by one "
          f"{1000 * (one - entered - (made - begun)):.0f} us each; {tiles} tiles, {tiles * 28_672 / 1e6:.1f} MB")
    print("size         view m/pixel   full ms  1 s on ms rows drawn  on screen ms")
    changed = {(size, near): asyncio.run(measure(size, near)) for size in ((120, 40), (240, 60))
               for near in (False, True)}
    return exit_code({"points entered lie in tiles": tiles > 0} | {
        f"{size[0]} x {size[1]}, {'near' if near else 'whole'}: {rows:g} rows drawn anew a second: some, not all":
            0.0 < rows < size[1] for (size, near), rows in changed.items()})


if __name__ == "__main__":
    sys.exit(main())

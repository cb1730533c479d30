"""What the tests of the app do alike: tell of another frame, turn to a page, wait until all is
shown, read it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from textual.worker import WorkerError


def rows_of(app) -> list[str]:
    """All text on the screen, row by row."""
    return [strip.text for strip in app.screen._compositor.render_strips()]


def text_of(app) -> str:
    return "\n".join(rows_of(app))


def tell(source, row=None, **frame) -> None:
    """The next frame: other than the last in this of its row, and of itself."""
    last = source.current_frame
    source.current_frame = replace(
        last, seq=last.seq + 1, row=last.row._replace(**row or {}), **frame
    )


def in_state(source, state, **frame) -> None:
    tell(source, {"state": state}, **frame)


def feed(app, rows, *, step_s=0.0, **frame) -> None:
    """Frames with these rows, one after the other; step_s: of the console's clock."""
    for row in rows:
        tell(app.source, row, **frame)
        app.clock.now_s += step_s
        app.show_newest()


async def turned(app, pilot, where) -> None:
    """To a page, until it is drawn with what is known now."""
    app.turn_to_page(where)
    await pilot.pause()
    await looked(app, pilot)


async def looked(app, pilot) -> None:
    """Until what is new is shown."""
    app.show_changes()
    for _again in range(2):
        await pilot.pause()


async def later(app, pilot, seconds=0.0) -> None:
    """One look of the console's own, so much later."""
    app.clock.now_s += seconds
    app.show_newest()
    await pilot.pause()


async def settled(app, pilot) -> None:
    """Until threads have answered and what they brought is shown."""
    for _again in range(3):
        for worker in [one for one in app.workers if one.group != "source"]:
            with suppress(WorkerError):
                await worker.wait()
        await looked(app, pilot)


async def until(pilot, true, seconds=10.0) -> None:
    for _again in range(int(seconds / 0.02)):
        if true():
            return
        await pilot.pause(0.02)
    raise AssertionError("it did not come")


def dots(cells) -> set[tuple[int, int]]:
    """Places (x, y) of all dots of braille cells, by the code chart: bits 0-2 and 6 left, 3-5
    and 7 right."""
    bits = {(0, 0): 0, (0, 1): 1, (0, 2): 2, (0, 3): 6, (1, 0): 3, (1, 1): 4, (1, 2): 5, (1, 3): 7}
    return {
        (2 * column + x, 4 * row + y)
        for (column, row), value in cells.items()
        for (x, y), bit in bits.items()
        if value >> bit & 1
    }


def linear(text) -> list[float]:
    """Linear RGB of #rrggbb."""
    channels = [int(text[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]


def lab(rgb) -> tuple[float, float, float]:
    """CIE L*a*b* of linear RGB, D65."""
    matrix = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
    xyz = [
        sum(w * c for w, c in zip(row, rgb, strict=True)) / white
        for row, white in zip(matrix, (0.9505, 1.0, 1.089), strict=True)
    ]
    f = [x ** (1 / 3) if x > 0.008856 else 7.787 * x + 16 / 116 for x in xyz]
    return 116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])

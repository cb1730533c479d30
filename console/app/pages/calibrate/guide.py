"""A guided sequence: what is done, what is to be done now, what comes after; below it what was
refused or found."""

from __future__ import annotations

from typing import NamedTuple

from textual.content import Content
from topdress.console.app.widgets.panel import Panel, fit, line, wrapped
from topdress.console.locale import _


class GuideStep(NamedTuple):
    """title: a few words; text: what to do, shown while it is the one to do."""

    title: str
    text: str


class GuideView(NamedTuple):
    """now: the step to do. said: why something is not possible now, in words. found: lines of
    the result."""

    title: str
    steps: tuple[GuideStep, ...]
    now: int = 0
    said: str = ""
    found: tuple[str, ...] = ()


class Guide(Panel[GuideView]):
    def lines(self, view: GuideView, width: int, height: int) -> list[Content]:
        tail: list[Content] = []
        if view.said:
            tail += [
                line(
                    (
                        fit(f" ! {row}" if not index else f"   {row}", width),
                        "bold $on-alarm-amber on $alarm-amber",
                    )
                )
                for index, row in enumerate(wrapped(view.said, width - 4))
            ]
        if view.found:
            tail.append(line((f" {_('found')}", "bold $primary")))
            tail += [
                line((f" {row}", "bold")) for one in view.found for row in wrapped(one, width - 2)
            ]
        rows = [line((f" {row}", "bold $primary")) for row in wrapped(view.title, width - 1)]
        room = height - len(tail) - len(rows)
        rows += self._steps(view.steps, view.now, width, room)
        rows += [line("")] * max(0, min(1, height - len(rows) - len(tail)))
        return (
            (rows + tail)
            if len(rows) + len(tail) <= height
            else [*rows[: max(1, height - len(tail))], *tail]
        )

    @staticmethod
    def _steps(steps: tuple[GuideStep, ...], now: int, width: int, room: int) -> list[Content]:
        """Titles of all steps, the text of the one to do; done ones go first where rows are few."""
        texts = [
            wrapped(step.text, width - 5) if index == now else []
            for index, step in enumerate(steps)
        ]
        spare = room - len(steps) - sum(map(len, texts))
        rows: list[Content] = []
        for index, step in enumerate(steps):
            if index < now and spare < 0:
                spare += 1
                continue
            mark = "✔" if index < now else "▸" if index == now else " "
            rows.append(
                line(
                    (
                        fit(f" {mark} {index + 1} {step.title}", width),
                        "bold" if index == now else "$muted",
                    )
                )
            )
            rows += [line((f"     {text}", "")) for text in texts[index]]
        return rows

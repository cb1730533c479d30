"""Draws a guided sequence: steps done, the step to do now, later steps, and below them refusals or
results.
"""

from __future__ import annotations

from typing import NamedTuple

from textual.content import Content
from topdress.console.app.widgets.base_panel import Panel, fit_text_width, make_line, wrap_text
from topdress.console.locale import _


class GuideStep(NamedTuple):
    """Holds a step: a title of a few words, and the instruction that is shown while the step is
    due."""

    title: str
    text: str


class GuideView(NamedTuple):
    """Holds a guide.

    Attributes
    ----------
    now
        Index of the step to do.
    said
        Reason why something is impossible now, in words.
    found
        Lines of the result.
    """

    title: str
    steps: tuple[GuideStep, ...]
    now: int = 0
    said: str = ""
    found: tuple[str, ...] = ()


class GuidePanel(Panel[GuideView]):
    """Shows the guide."""

    def draw_rows(self, view: GuideView, width: int, height: int) -> list[Content]:
        tail: list[Content] = []
        if view.said:
            tail += [
                make_line(
                    (
                        fit_text_width(f" ! {row}" if not index else f"   {row}", width),
                        "bold $on-alarm-amber on $alarm-amber",
                    )
                )
                for index, row in enumerate(wrap_text(view.said, width - 4))
            ]
        if view.found:
            tail.append(make_line((f" {_('found')}", "bold $primary")))
            tail += [
                make_line((f" {row}", "bold"))
                for one in view.found
                for row in wrap_text(one, width - 2)
            ]
        rows = [make_line((f" {row}", "bold $primary")) for row in wrap_text(view.title, width - 1)]
        room = height - len(tail) - len(rows)
        rows += self._draw_steps(view.steps, view.now, width, room)
        # An empty row separates steps and result where there is room.
        rows += [make_line("")] * max(0, min(1, height - len(rows) - len(tail)))
        # Refusal and result are shown whole; on a low screen the steps lose rows.
        return (
            (rows + tail)
            if len(rows) + len(tail) <= height
            else [*rows[: max(1, height - len(tail))], *tail]
        )

    @staticmethod
    def _draw_steps(steps: tuple[GuideStep, ...], now: int, width: int, room: int) -> list[Content]:
        """Return the titles of all steps, and the text of the step to do. Finished steps are
        dropped first where rows are scarce."""
        # Only the step to do has its instruction: later ones would distract.
        texts = [
            wrap_text(step.text, width - 5) if index == now else []
            for index, step in enumerate(steps)
        ]
        spare = room - len(steps) - sum(map(len, texts))
        rows: list[Content] = []
        for index, step in enumerate(steps):
            if index < now and spare < 0:
                spare += 1
                continue
            # Signs distinguish the steps without colour.
            mark = "✔" if index < now else "▸" if index == now else " "
            rows.append(
                make_line(
                    (
                        fit_text_width(f" {mark} {index + 1} {step.title}", width),
                        "bold" if index == now else "$muted",
                    )
                )
            )
            rows += [make_line((f"     {text}", "")) for text in texts[index]]
        return rows

"""Channel by channel: how far the machine file is off, before and after the causes are in it,
along with the noise."""

from __future__ import annotations

from typing import NamedTuple

from textual.content import Content
from topdress.console.app.widgets.panel import Panel, fit, line, right, wrapped
from topdress.console.locale import _


class ChannelLine(NamedTuple):
    """wrong: more than noise is there."""

    name: str
    unit: str
    error: str
    after: str
    noise: str
    beyond: str
    wrong: bool


class ChannelsView(NamedTuple):
    channels: tuple[ChannelLine, ...]
    # what is said of the data, and what no cause explains
    left: tuple[str, ...]
    gains: tuple[str, ...]
    language: str


class ChannelTable(Panel[ChannelsView]):
    def lines(self, view: ChannelsView, width: int, height: int) -> list[Content]:
        rows = [
            line(
                (fit(f" {_('channels')}: {_('error of the machine file')}", width), "bold $primary")
            ),
            line(
                (
                    self._row(
                        _("channel"), _("before"), _("after"), _("noise"), _("beyond noise"), width
                    ),
                    "$muted",
                )
            ),
        ]
        for one in view.channels:
            name = f"{'!' if one.wrong else ' '} {one.name}, {one.unit}"
            rows.append(
                line(
                    (
                        self._row(name, one.error, one.after, one.noise, one.beyond, width),
                        "bold" if one.wrong else "",
                    )
                )
            )
        rows += [
            line((fit(f" {row}", width), "$muted"))
            for text in view.left
            for row in wrapped(text, width - 2)
        ]
        return rows + [
            line((f" {row}", "$muted")) for text in view.gains for row in wrapped(text, width - 2)
        ]

    @staticmethod
    def _row(name: str, error: str, after: str, noise: str, beyond: str, width: int) -> str:
        columns = "".join(right(text, 9) for text in (error, after, noise))
        last = right(beyond, 14)
        return fit(f" {fit(name, max(8, width - 43))} {columns}{last}", width)

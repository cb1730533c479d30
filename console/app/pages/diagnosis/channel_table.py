"""Shows for each channel the error of the machine file, before and after the causes are included,
and the noise.
"""

from __future__ import annotations

from typing import NamedTuple

from textual.content import Content
from topdress.console.app.widgets.base_panel import (
    Panel,
    align_text_right,
    fit_text_width,
    make_line,
    wrap_text,
)
from topdress.console.locale import _


class ChannelLine(NamedTuple):
    """Holds one channel; `wrong` is True if the error exceeds the noise."""

    name: str
    unit: str
    error: str
    after: str
    noise: str
    beyond: str
    wrong: bool


class ChannelsView(NamedTuple):
    """Holds the channels."""

    channels: tuple[ChannelLine, ...]
    # Remarks on the data, and errors that no cause explains.
    left: tuple[str, ...]
    gains: tuple[str, ...]
    language: str


class ChannelTable(Panel[ChannelsView]):
    """Shows the channels."""

    def draw_rows(self, view: ChannelsView, width: int, height: int) -> list[Content]:
        rows = [
            make_line(
                (
                    fit_text_width(f" {_('channels')}: {_('error of the machine file')}", width),
                    "bold $primary",
                )
            ),
            make_line(
                (
                    self._format_row(
                        _("channel"), _("before"), _("after"), _("noise"), _("beyond noise"), width
                    ),
                    "$muted",
                )
            ),
        ]
        for one in view.channels:
            # The sign marks an error beyond noise without colour.
            name = f"{'!' if one.wrong else ' '} {one.name}, {one.unit}"
            rows.append(
                make_line(
                    (
                        self._format_row(name, one.error, one.after, one.noise, one.beyond, width),
                        "bold" if one.wrong else "",
                    )
                )
            )
        rows += [
            make_line((fit_text_width(f" {row}", width), "$muted"))
            for text in view.left
            for row in wrap_text(text, width - 2)
        ]
        return rows + [
            make_line((f" {row}", "$muted"))
            for text in view.gains
            for row in wrap_text(text, width - 2)
        ]

    @staticmethod
    def _format_row(name: str, error: str, after: str, noise: str, beyond: str, width: int) -> str:
        """Return a row of the table as text, in columns."""
        # Numbers are aligned right, so that sizes can be compared.
        columns = "".join(align_text_right(text, 9) for text in (error, after, noise))
        last = align_text_right(beyond, 14)
        return fit_text_width(f" {fit_text_width(name, max(8, width - 43))} {columns}{last}", width)

"""The settings one below the other, as many as there is room for around the marked one. A click marks and changes."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.pages.job.day import file_name
from console.app.widgets.panel import Panel, Part, Picked, fit, fullest, line, wrapped


class SettingLine(NamedTuple):
    """group: a heading, shown before the first line of it. own: other than delivered."""

    group: str
    label: str
    value: str
    own: bool
    hint: str


class SettingsView(NamedTuple):
    lines: tuple[SettingLine, ...]
    at: int
    place: str                  # the file
    trouble: str                # why it was not used


class SettingsList(Panel[SettingsView]):
    """Posts Picked."""

    def lines(self, view: SettingsView, width: int, height: int) -> list[Content]:
        head = self._head(view, width)
        label = max((cell_len(one.label) for one in view.lines), default=0) + 4
        value = min(max((cell_len(one.value) for one in view.lines), default=0) + 3, max(12, width // 3))
        rows = []
        foot = self._foot(view, width)
        for index in self._rows(view, height - len(head) - len(foot)):
            if isinstance(index, str):
                rows.append(line((fit(f" {index}", width), "bold $primary")))
                continue
            one = view.lines[index]
            here = index == view.at
            style = "bold $on-select on $select" if here else "bold" if one.own else ""
            parts: list[Part] = [(fit(f" {'>' if here else ' '} {one.label}", label), style),
                                 (fit(f" {'*' if one.own else ' '}{one.value}", value), style or "bold"),
                                 (fullest((f" {one.hint}", ""), width - label - value), "$muted")]
            rows.append(line(*parts))
        return [*head, *rows, *[line("")] * (height - len(head) - len(rows) - len(foot)), *foot]

    @staticmethod
    def _head(view: SettingsView, width: int) -> list[Content]:
        """The file, and why it was not used."""
        place = fullest((view.place, file_name(view.place)), width - 1)
        trouble = wrapped(view.trouble, width - 4)
        return [line((f" {place}", "$muted")),
                *(line((fit(f" {'!' if not k else ' '} {row}", width), "bold $on-alarm-amber on $alarm-amber"))
                  for k, row in enumerate(trouble))]

    @staticmethod
    def _foot(view: SettingsView, width: int) -> list[Content]:
        """What the marked setting is about, in full, and as many rows for each: the list must not jump."""
        count = max((len(wrapped(one.hint, width - 2)) for one in view.lines), default=0)
        said = wrapped(view.lines[view.at].hint, width - 2) if view.at < len(view.lines) else []
        return [line((f" {row}", "$muted")) for row in (said + [""] * count)[:count]]

    def _rows(self, view: SettingsView, height: int) -> list[int | str]:
        """Indices of lines and texts of headings that are shown, the marked line always among them."""
        rows: list[int | str] = []
        group = None
        for index, one in enumerate(view.lines):
            if one.group != group:
                group = one.group
                rows.append(group)
            rows.append(index)
        at = rows.index(view.at) if view.at in rows else 0
        first = max(0, min(at - height // 2, len(rows) - height))
        return rows[first:first + max(0, height)]

    def _shown(self) -> tuple[int, list[int | str]]:
        """Rows above the list, and what stands in its rows."""
        width = self.content_size.width
        head, foot = len(self._head(self.view, width)), len(self._foot(self.view, width))
        return head, self._rows(self.view, self.content_size.height - head - foot)

    def places(self) -> tuple[tuple[int, int], ...]:
        head, rows = self._shown()
        return tuple((0, head + row) for row, one in enumerate(rows) if isinstance(one, int))

    def on_click(self, event: events.Click) -> None:
        event.stop()
        head, rows = self._shown()
        if 0 <= event.y - head < len(rows):
            picked = rows[event.y - head]
            if isinstance(picked, int):
                self.post_message(Picked(picked))

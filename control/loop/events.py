"""Which events does a log row contain? Events and rows are limited to the lengths that readers
of a log accept.
"""

from __future__ import annotations

from collections import deque

# Maximum length of an event, characters, which is also the maximum for an operator's mark.
MAX_EVENT_LETTERS = 1_000
# Maximum length of a row's events, characters, separators included: even a row of commas would then
# be accepted by a reader with at most 2,000 columns.
MAX_ROW_LETTERS = 1_800
# Maximum number of waiting events; further events are only counted.
MAX_WAITING_EVENTS = 1_000
_CUT_MARK = "..."


class EventQueue:
    """Stores events until their row: `add_events` when they occur, `take_row_events` once a
    tick. The order is kept; events that exceed a row wait for the next."""

    def __init__(self) -> None:
        self._waiting: deque[str] = deque()
        self._left_out = 0

    @property
    def is_full(self) -> bool:
        return len(self._waiting) >= MAX_WAITING_EVENTS

    def add_events(self, *events: str) -> None:
        for event in events:
            if self.is_full:
                self._left_out += 1
            else:
                self._waiting.append(
                    event
                    if len(event) <= MAX_EVENT_LETTERS
                    else event[: MAX_EVENT_LETTERS - len(_CUT_MARK)] + _CUT_MARK
                )

    def take_row_events(self) -> list[str]:
        """Returns the events for the next row."""
        found: list[str] = []
        left = MAX_ROW_LETTERS
        while self._waiting and (left := left - len(self._waiting[0]) - 1) >= 0:
            found.append(self._waiting.popleft())
        if self._left_out and not self._waiting:
            self._waiting.append(f"events_left_out {self._left_out}")
            self._left_out = 0
        return found

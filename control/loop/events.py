"""Which events does a row take? No event is longer, and no row has more, than readers of a log
accept."""

from __future__ import annotations

from collections import deque

# Longest event, characters; an operator's mark may be as long.
EVENT_CHARACTERS = 1_000
# Greatest length of a row's events, characters, separators included: even if each were a comma, a
# reader that looks for columns (2,000 at most) would accept the row.
ROW_CHARACTERS = 1_800
# Greatest number of waiting events; of later ones only the number is kept.
MAX_WAITING = 1_000
_CUT_MARK = "..."


class EventQueue:
    """Holds events until their row. `add` as they happen, `take_row_events` once a tick. They keep
    their order; what one row cannot hold waits for the next."""

    def __init__(self) -> None:
        self._waiting: deque[str] = deque()
        self._left_out = 0

    @property
    def is_full(self) -> bool:
        return len(self._waiting) >= MAX_WAITING

    def add_events(self, *events: str) -> None:
        for event in events:
            if self.is_full:
                self._left_out += 1
            else:
                self._waiting.append(
                    event
                    if len(event) <= EVENT_CHARACTERS
                    else event[: EVENT_CHARACTERS - len(_CUT_MARK)] + _CUT_MARK
                )

    def take_row_events(self) -> list[str]:
        """Returns the events that the next row takes."""
        found: list[str] = []
        left = ROW_CHARACTERS
        while self._waiting and (left := left - len(self._waiting[0]) - 1) >= 0:
            found.append(self._waiting.popleft())
        if self._left_out and not self._waiting:
            self._waiting.append(f"events_left_out {self._left_out}")
            self._left_out = 0
        return found

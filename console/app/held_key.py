"""Decides whether a key or mouse button is held down, which is the condition for a turning shaft.
Pure: times are arguments.

A terminal reports no release of a key, only repeats. The first press arms. A second press within a
second means that the key is held: repeats begin after 0.25 to 0.7 s and then come 10 to 30 times a
second. A gap means a release. A single accidental press therefore turns nothing.
"""

from __future__ import annotations

# Longest delay before a terminal's first repeat, s.
MAX_FIRST_REPEAT_S = 1.0
# A longer gap between repeats, s, counts as a release; the slowest usual repeat period is 0.092 s.
MAX_REPEAT_GAP_S = 0.25


class HeldKey:
    """Decides whether a key is held. Call `note_key` at every press or repeat and `note_mouse` at
    every change of the button."""

    def __init__(self) -> None:
        self._first_s: float | None = None
        # Time of the newest repeat while the key is held, s.
        self._last_s: float | None = None
        self._mouse = False
        # Time of the newest repeat after a refusal; presses are ignored until a gap shows that the
        # key was released.
        self._blocked_s: float | None = None

    @property
    def is_armed(self) -> bool:
        """Whether the key was pressed once, so that the next press runs the shaft."""
        return self._first_s is not None and self._last_s is None

    def note_key(self, now_s: float) -> None:
        """Record a press or repeat."""
        if self._blocked_s is not None:
            if now_s - self._blocked_s <= MAX_REPEAT_GAP_S:
                self._blocked_s = now_s
                return
            self._blocked_s = None
        held = self._last_s is not None and now_s - self._last_s <= MAX_REPEAT_GAP_S
        second = (
            self.is_armed
            and self._first_s is not None
            and now_s - self._first_s <= MAX_FIRST_REPEAT_S
        )
        if held or second:
            self._last_s = now_s
        else:
            self._first_s, self._last_s = now_s, None

    def note_mouse(self, down: bool) -> None:
        """Record the state of the mouse button."""
        self._mouse = down

    def release_all(self) -> None:
        """Forget all presses, after a change of page or a lock of the keys."""
        self._first_s = self._last_s = None
        self._mouse = False

    def block_repeats(self, now_s: float) -> None:
        """Release, and ignore the repeats of a key that is still down."""
        self._blocked_s = now_s if self._last_s is not None else None
        self.release_all()

    def is_down(self, now_s: float) -> bool:
        """Whether the key or the button is held at this time."""
        if self._last_s is not None and now_s - self._last_s > MAX_REPEAT_GAP_S:
            self._first_s = self._last_s = None
        if (
            self._first_s is not None
            and self._last_s is None
            and now_s - self._first_s > MAX_FIRST_REPEAT_S
        ):
            self._first_s = None
        return self._mouse or self._last_s is not None

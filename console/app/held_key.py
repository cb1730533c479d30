"""A key or a mouse button that must stay down while the shaft turns. Pure: times come in, down
or up comes out.

A terminal tells no release of a key, only its repeats: the first press arms, the second within
a second means that the key is held (repeats begin after 0.25 to 0.7 s and then come 10 to 30
times a second), and a gap means that it was let go. A stray press therefore turns nothing.
"""

from __future__ import annotations

FIRST_REPEAT_S = 1.0  # longest delay before a terminal's first repeat
REPEAT_GAP_S = 0.25  # slowest usual repeat: 0.092 s


class HeldKey:
    """Decides whether a key is held. `note_key` at every press or repeat, `note_mouse` at every
    change of the button, `is_down` at any time."""

    def __init__(self) -> None:
        self._first_s: float | None = None
        self._last_s: float | None = None  # of a key that is held
        self._mouse = False
        # ended by a refusal: nothing counts until the key was let go
        self._blocked_s: float | None = None

    @property
    def is_armed(self) -> bool:
        """Whether it was pressed once: the next press runs."""
        return self._first_s is not None and self._last_s is None

    def note_key(self, now_s: float) -> None:
        """Note a press or repeat."""
        if self._blocked_s is not None:
            if now_s - self._blocked_s <= REPEAT_GAP_S:
                self._blocked_s = now_s
                return
            self._blocked_s = None
        held = self._last_s is not None and now_s - self._last_s <= REPEAT_GAP_S
        second = (
            self.is_armed and self._first_s is not None and now_s - self._first_s <= FIRST_REPEAT_S
        )
        if held or second:
            self._last_s = now_s
        else:
            self._first_s, self._last_s = now_s, None

    def note_mouse(self, down: bool) -> None:
        """Note the state of the mouse button."""
        self._mouse = down

    def release_all(self) -> None:
        """Forget all presses: another page, the lock."""
        self._first_s = self._last_s = None
        self._mouse = False

    def block_repeats(self, now_s: float) -> None:
        """Let go, and do not begin again by the repeats of a key that is still down."""
        self._blocked_s = now_s if self._last_s is not None else None
        self.release_all()

    def is_down(self, now_s: float) -> bool:
        """Whether key or button is held."""
        if self._last_s is not None and now_s - self._last_s > REPEAT_GAP_S:
            self._first_s = self._last_s = None
        if (
            self._first_s is not None
            and self._last_s is None
            and now_s - self._first_s > FIRST_REPEAT_S
        ):
            self._first_s = None
        return self._mouse or self._last_s is not None

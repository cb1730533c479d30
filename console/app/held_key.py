"""A key or a mouse button that must stay down while the shaft turns. Pure: times come in, down
or up comes out.

A terminal tells no release of a key, only its repeats: the first press arms, the second within
a second means that the key is held (repeats begin after 0.25 to 0.7 s and then come 10 to 30
times a second), and a gap means that it was let go. A stray press therefore turns nothing.
"""

from __future__ import annotations

SECOND_PRESS_S = 1.0  # longest delay before a terminal's first repeat
KEY_GAP_S = 0.25  # slowest usual repeat: 0.092 s


class HeldKey:
    """`key` at every press or repeat, `mouse` at every change of the button, `down` at any time."""

    def __init__(self) -> None:
        self._first_s: float | None = None
        self._last_s: float | None = None  # of a key that is held
        self._mouse = False
        # ended by a refusal: nothing counts until the key was let go
        self._blocked_s: float | None = None

    @property
    def armed(self) -> bool:
        """Pressed once: the next press runs."""
        return self._first_s is not None and self._last_s is None

    def key(self, now_s: float) -> None:
        if self._blocked_s is not None:
            if now_s - self._blocked_s <= KEY_GAP_S:
                self._blocked_s = now_s
                return
            self._blocked_s = None
        held = self._last_s is not None and now_s - self._last_s <= KEY_GAP_S
        second = (
            self.armed and self._first_s is not None and now_s - self._first_s <= SECOND_PRESS_S
        )
        if held or second:
            self._last_s = now_s
        else:
            self._first_s, self._last_s = now_s, None

    def mouse(self, down: bool) -> None:
        self._mouse = down

    def let_go(self) -> None:
        """As if nothing were pressed: another page, the lock."""
        self._first_s = self._last_s = None
        self._mouse = False

    def block(self, now_s: float) -> None:
        """Let go, and do not begin again by the repeats of a key that is still down."""
        self._blocked_s = now_s if self._last_s is not None else None
        self.let_go()

    def down(self, now_s: float) -> bool:
        if self._last_s is not None and now_s - self._last_s > KEY_GAP_S:
            self._first_s = self._last_s = None
        if (
            self._first_s is not None
            and self._last_s is None
            and now_s - self._first_s > SECOND_PRESS_S
        ):
            self._first_s = None
        return self._mouse or self._last_s is not None

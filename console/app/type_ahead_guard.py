"""Swallows keys that were typed for a question that was refused.

An operator presses the key of a dialog and continues to type the value without looking. Where the
dialog was refused, the page would receive these keys: a digit would be lost, Enter would begin
something, a letter of a name would act. They are swallowed until nothing was typed for a while.
Hold and STOP always work.
"""

from __future__ import annotations

# A longer pause, s, means that the operator has looked at the screen.
MAX_TYPING_PAUSE_S = 2.0
# Keys that belong to a number.
_NUMBER_KEYS = frozenset(
    {
        "full_stop",
        "comma",
        "plus",
        "minus",
        "equals_sign",
        "backspace",
        "delete",
        "enter",
        *(f"kp_{name}" for name in ("decimal", "plus", "minus", "enter")),
    }
)


# A question that was visible for less than this, s, was not read.
MIN_READING_TIME_S = 0.7


class HeldEnter:
    """Detects an Enter that is held down or pressed twice: it answers one question and must not
    answer the next question."""

    def __init__(self) -> None:
        self._screen: object = None
        self._last_s = float("-inf")

    def is_repeat(self, screen: object, now_s: float) -> bool:
        """Return whether this Enter still belongs to the former screen; `screen` would receive
        it."""
        soon, self._last_s = now_s - self._last_s < MIN_READING_TIME_S, now_s
        if soon and screen is not self._screen and self._screen is not None:
            return True
        self._screen = screen
        return False


class TypeAheadGuard:
    """Swallows keys typed for a question that was refused."""

    def __init__(self) -> None:
        self._kind = ""
        self._until_s = float("-inf")

    def note_refusal(self, kind: str, now_s: float) -> None:
        """Record a refused question; `kind` is the expected input: "number", "text", or "" for
        none."""
        self._kind, self._until_s = kind, now_s + MAX_TYPING_PAUSE_S

    def is_swallowed(self, key: str, now_s: float) -> bool:
        """Return whether a key is swallowed. Any other key ends the guard, because then the
        operator means something else."""
        if not self._kind or now_s >= self._until_s:
            return False
        typed = (
            key in _NUMBER_KEYS
            or key.removeprefix("kp_").isdigit()
            or (self._kind == "text" and (len(key) == 1 or key == "underscore"))
        )
        self._kind, self._until_s = (
            (self._kind, now_s + MAX_TYPING_PAUSE_S) if typed else ("", self._until_s)
        )
        return typed

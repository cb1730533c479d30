"""What is typed for a question that was never asked goes nowhere.

An operator presses the key of a dialog and goes on typing the value without looking. Where the
dialog was refused, the page has these keys: a digit would be lost, Enter would begin something,
a letter of a name would act. So they are swallowed until nothing was typed for a while. Hold
and STOP are never among them.
"""

from __future__ import annotations

TYPING_PAUSE_S = 2.0
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


UNREAD_S = 0.7  # a question that has stood for less was not read


class HeldEnter:
    """Detects an Enter that is held down, or struck twice: it answers one question and not the next
    one that opens under it."""

    def __init__(self) -> None:
        self._screen: object = None
        self._last_s = float("-inf")

    def is_repeat(self, screen: object, now_s: float) -> bool:
        """Whether it is still the Enter of the screen before. screen: that gets this Enter."""
        soon, self._last_s = now_s - self._last_s < UNREAD_S, now_s
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
        """Note a refused question. kind: what would have been typed, "number" or "text"; "":
        nothing."""
        self._kind, self._until_s = kind, now_s + TYPING_PAUSE_S

    def is_swallowed(self, key: str, now_s: float) -> bool:
        """Whether a key is swallowed. key: as Textual names it. Any other key ends it, for then
        something else is meant."""
        if not self._kind or now_s >= self._until_s:
            return False
        typed = (
            key in _NUMBER_KEYS
            or key.removeprefix("kp_").isdigit()
            or (self._kind == "text" and (len(key) == 1 or key == "underscore"))
        )
        self._kind, self._until_s = (
            (self._kind, now_s + TYPING_PAUSE_S) if typed else ("", self._until_s)
        )
        return typed

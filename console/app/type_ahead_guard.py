"""What is typed for a question that was never asked goes nowhere.

An operator presses the key of a dialog and goes on typing the value without looking. Where the
dialog was refused, the page has these keys: a digit would be lost, Enter would begin something,
a letter of a name would act. So they are swallowed until nothing was typed for a while. Hold
and STOP are never among them.
"""

from __future__ import annotations

PAUSE_S = 2.0
_OF_NUMBERS = frozenset(
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


READ_S = 0.7  # a question that has stood for less was not read


class HeldEnter:
    """An Enter that is held down, or struck twice, answers one question and not the next one
    that opens under it."""

    def __init__(self) -> None:
        self._screen: object = None
        self._last_s = float("-inf")

    def repeats(self, screen: object, now_s: float) -> bool:
        """screen: that gets this Enter. True: it is still the Enter of the screen before."""
        soon, self._last_s = now_s - self._last_s < READ_S, now_s
        if soon and screen is not self._screen and self._screen is not None:
            return True
        self._screen = screen
        return False


class StrayTyping:
    def __init__(self) -> None:
        self._kind = ""
        self._until_s = float("-inf")

    def refused(self, kind: str, now_s: float) -> None:
        """kind: what would have been typed, "number" or "text"; "": nothing."""
        self._kind, self._until_s = kind, now_s + PAUSE_S

    def swallows(self, key: str, now_s: float) -> bool:
        """key: as Textual names it. Any other key ends it, for then something else is meant."""
        if not self._kind or now_s >= self._until_s:
            return False
        typed = (
            key in _OF_NUMBERS
            or key.removeprefix("kp_").isdigit()
            or (self._kind == "text" and (len(key) == 1 or key == "underscore"))
        )
        self._kind, self._until_s = (self._kind, now_s + PAUSE_S) if typed else ("", self._until_s)
        return typed

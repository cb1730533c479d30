"""Which key is meant by one that was pressed: Caps Lock, Shift, a full-width input method and
other layouts do not keep an operator from STOP, nor from any other letter.

Terminals send Shift and a letter as the capital ("X"), with the kitty keyboard protocol also as
"shift+x"; Caps Lock as the capital; Shift+F12 as "shift+f12" or, on older ones, as "f24".
"""

from __future__ import annotations

import unicodedata
from collections.abc import Set

# whatever the keymap says, also where a text field has the focus
ALWAYS_STOP = "f12"
# as the arrow keys are shown
_SAME_KEYS = {
    "less_than_sign": "left",
    "greater_than_sign": "right",
    # ctrl+@: Ctrl+Space
    "f24": "f12",
    "ideographic_space": "space",
    "no_break_space": "space",
    "@": "space",
}
# Letters on the key of X: Russian and Ukrainian, Serbian and Macedonian, Greek, Hebrew, Arabic,
# Georgian, Thai, Korean, Japanese kana, Bopomofo; and the Cyrillic and Greek letters that look
# like X.
_ON_THE_KEY_OF_X = frozenset("чџχסءხปㅌさㄌх")


def normalise_key(key: str, bound: Set[str], urgent: Set[str]) -> str:
    """The key that is meant by a pressed one.

    key: as Textual names it. bound: keys that have an action here. urgent: those of hold and STOP,
    which are taken with any modifier and, for X, from other layouts.
    """
    *held, last = key.split("+")
    last = _SAME_KEYS.get(last, last) if last != "@" or held else last
    if last == ALWAYS_STOP:
        return last
    if key in bound:
        return key
    if last in ("left", "right") and "+".join((*held, last)) in bound:
        return "+".join((*held, last))
    letter = _narrow_letter(last).lower() if len(last) == 1 else last
    bare = "x" if {letter, last} & _ON_THE_KEY_OF_X else letter
    if bare in urgent:
        return bare
    if len(letter) != 1 or not letter.isalnum():
        return key
    if letter.upper() in bound and "shift" in held:
        return letter.upper()
    return "+".join((*(one for one in held if one != "shift"), letter))


def _narrow_letter(letter: str) -> str:
    """A full-width letter or digit as the plain one; a superscript two is no 2."""
    return (
        unicodedata.normalize("NFKC", letter)
        if unicodedata.decomposition(letter).startswith("<wide>")
        else letter
    )

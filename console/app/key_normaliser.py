"""Determines which key an operator meant: Caps Lock, Shift, full-width input and other layouts must
not prevent STOP or any other letter.

Terminals send Shift and a letter as the capital ("X"), with the kitty keyboard protocol also as
"shift+x". They send Caps Lock as the capital, and Shift+F12 as "shift+f12" or, on older terminals,
as "f24".
"""

from __future__ import annotations

import unicodedata
from collections.abc import Set

# This key stops the machine whatever the keymap contains, even where a text field has the focus.
STOP_KEY = "f12"
# The key bar prints arrow keys as < and >, so these characters act as arrows.
_KEY_OF_SYNONYM = {
    "less_than_sign": "left",
    "greater_than_sign": "right",
    # Terminals send Ctrl+Space as ctrl+@.
    "f24": "f12",
    "ideographic_space": "space",
    "no_break_space": "space",
    "@": "space",
}
# Letters on the key of X in other layouts: Russian and Ukrainian, Serbian and Macedonian, Greek,
# Hebrew, Arabic, Georgian, Thai, Korean, Japanese kana, Bopomofo. The Cyrillic and Greek letters
# that resemble X are included.
_ON_THE_KEY_OF_X = frozenset("чџχסءხปㅌさㄌх")


def normalise_key(key: str, bound: Set[str], urgent: Set[str]) -> str:
    """Return the key that the operator meant.

    Parameters
    ----------
    key
        Key as Textual names it.
    bound
        Keys that have an action on this screen.
    urgent
        Keys of hold and STOP, which are accepted with any modifier and, for X, from other layouts.
    """
    *held, last = key.split("+")
    last = _KEY_OF_SYNONYM.get(last, last) if last != "@" or held else last
    # STOP precedes the keymap: no binding can take its key.
    if last == STOP_KEY:
        return last
    # A key that has its own action keeps it: a capital may differ from the small letter.
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
    """Return the plain letter for a full-width letter or digit; superscript digits are left
    unchanged."""
    return (
        unicodedata.normalize("NFKC", letter)
        if unicodedata.decomposition(letter).startswith("<wide>")
        else letter
    )

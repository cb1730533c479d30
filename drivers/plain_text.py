"""Text from files, devices and networks before a terminal sees it: characters that steer a terminal are left out.

Control characters of both sets (C0 but for the end of a line and the tabulator, DEL, C1), which begin escape sequences,
and the marks that turn the direction of writing round, with which a text can show something else than it says
(Unicode Technical Report 36, section 2.7).
"""
from __future__ import annotations

_STEERING = [*(code for code in range(32) if chr(code) not in "\n\t"), *range(127, 160), 0x061C, 0x200E, 0x200F,
             *range(0x202A, 0x202F), *range(0x2066, 0x206A)]
_WITHOUT = dict.fromkeys(_STEERING)


def plain(text: str) -> str:
    """The text without what steers a terminal. Any character that is left is shown as itself."""
    return text if text.isprintable() else text.translate(_WITHOUT)


def one_line(text: str) -> str:
    """The same in one line: a message that quotes a file, in which anything may stand."""
    return " ".join(part for part in map(str.strip, plain(text.replace("\r", "\n")).splitlines()) if part)


class OneLine(ValueError):
    """A refusal in one line, whatever the file holds that it quotes."""

    def __init__(self, text: str = "") -> None:
        super().__init__(one_line(text))

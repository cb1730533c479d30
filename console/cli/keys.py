"""Keys of the terminal as they are pressed, without waiting for a line; POSIX and Windows."""
from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Iterator


class Keys:
    """`pressed`: what was typed since the last call, as text. Nothing where standard input is no terminal."""

    def __init__(self, there: bool) -> None:
        self.there = there

    def pressed(self) -> str:
        if not self.there:
            return ""
        if sys.platform == "win32":
            import msvcrt
            typed = ""
            while msvcrt.kbhit():
                typed += msvcrt.getwch()
            return typed
        ready = select.select([sys.stdin], [], [], 0.0)[0]
        return os.read(sys.stdin.fileno(), 256).decode(errors="replace") if ready else ""


@contextlib.contextmanager
def keys() -> Iterator[Keys]:
    """The keyboard until the end of the block; Ctrl+C still interrupts."""
    if not sys.stdin.isatty():
        yield Keys(False)
        return
    if sys.platform == "win32":
        yield Keys(True)
        return
    import termios
    import tty
    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield Keys(True)
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)

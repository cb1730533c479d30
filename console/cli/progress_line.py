"""The one line of progress that commands have: it rewrites itself on a terminal's stderr, and is silent elsewhere."""
from __future__ import annotations

import shutil
import sys

from console.cli.plain_output import OVER_THE_LINE


class ProgressLine:
    """`tell` puts a text over the one before, `end` takes it away. A text is cut to the terminal's width: one that goes
    on in the next row would leave its first row behind."""

    def __init__(self) -> None:
        self.shown = sys.stderr.isatty()
        self._stands = False

    def tell(self, text: str) -> None:
        if self.shown:
            self._write(text[:shutil.get_terminal_size().columns - 1])
            self._stands = True

    def end(self) -> None:
        if self._stands:
            self._write("")
            self._stands = False

    @staticmethod
    def _write(text: str) -> None:
        sys.stderr.write(f"{OVER_THE_LINE}{text}")
        sys.stderr.flush()

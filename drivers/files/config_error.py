"""What is wrong with configuration files, apart from what reads them: whoever only tells it
needs no more than this."""

from __future__ import annotations

from collections.abc import Iterable

from topdress.drivers.plain_text import join_lines


class ConfigError(Exception):
    """`lines`: one sentence for each thing that is wrong, ready to be shown."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple(map(join_lines, lines))
        super().__init__("\n".join(self.lines))

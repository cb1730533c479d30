"""What is wrong with a configuration file? This module stands alone, for callers that only
report it."""

from __future__ import annotations

from collections.abc import Iterable

from topdress.drivers.plain_text import join_lines


class ConfigError(Exception):
    """The configuration is wrong. `lines`: a sentence for each error, ready to be shown."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple(map(join_lines, lines))
        super().__init__("\n".join(self.lines))

"""Which errors does a configuration file have? This module imports nothing else, for callers that
only report the errors.
"""

from __future__ import annotations

from collections.abc import Iterable

from topdress.drivers.plain_text import join_lines


class ConfigError(Exception):
    """Reports a wrong configuration. `lines` holds a sentence for each error, ready for display."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple(map(join_lines, lines))
        super().__init__("\n".join(self.lines))

"""Help in words: what an argument is called says what it is; Python's name for its type is left out."""
from __future__ import annotations

import re
from typing import Any

from typer.core import TyperCommand

_TYPES = re.compile(r" <(?:str|int|float|path|list\[\w+\])>")


class PlainCommand(TyperCommand):
    def get_help(self, ctx: Any) -> str:
        return _TYPES.sub("", super().get_help(ctx))

"""Help in words: an argument's name says what it is, ranges are written out, no types and signs of Python."""
from __future__ import annotations

import re
from typing import Any

from typer.core import TyperCommand

_TYPES = re.compile(r"^(  .*?)( <(?:str|int|float|path|list\[\w+\])>)( *)", re.MULTILINE)
_NUMBER = r"-?[\d.]+(?:e[-+]?\d+)?"
_RANGE = re.compile(rf"(?P<low>{_NUMBER})<=x<=(?P<high>{_NUMBER})|x>=(?P<least>{_NUMBER})|x<=(?P<most>{_NUMBER})")


def ranges_in_words(text: str) -> str:
    """`1<=x<=100` as from 1 to 100, `x>=0.0` as 0 or more, `x<=9` as at most 9."""
    def words(found: re.Match[str]) -> str:
        number = {name: value.removesuffix(".0") for name, value in found.groupdict().items() if value is not None}
        if "low" in number:
            return f"from {number['low']} to {number['high']}"
        return f"{number['least']} or more" if "least" in number else f"at most {number['most']}"

    return _RANGE.sub(words, text)


class PlainCommand(TyperCommand):
    def get_help(self, ctx: Any) -> str:
        """What is left out leaves its room: the texts behind stay in their column."""
        said = _TYPES.sub(lambda found: found[1] + " " * len(found[2]) + found[3] if found[3] else found[1],
                          super().get_help(ctx))
        return ranges_in_words(said)

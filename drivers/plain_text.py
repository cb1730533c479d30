"""Which characters of foreign text may a terminal show? Characters that control a terminal are
removed.

They are the control characters of both sets (C0 except line feed and tabulator, DEL, C1), which
begin escape sequences, and the marks that reverse the direction of writing, with which a text can
appear different from its content (Unicode Technical Report 36, section 2.7).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Self

# Code points of the characters that are removed.
CONTROL_CODES = [
    *(code for code in range(32) if chr(code) not in "\n\t"),
    *range(127, 160),
    0x061C,
    0x200E,
    0x200F,
    *range(0x202A, 0x202F),
    *range(0x2066, 0x206A),
]
_CONTROL_REMOVAL = dict.fromkeys(CONTROL_CODES)


def remove_control_characters(text: str) -> str:
    """Returns the text without characters that control a terminal. All other characters stay."""
    return text if text.isprintable() else text.translate(_CONTROL_REMOVAL)


def join_lines(text: str) -> str:
    """Returns the text as one line, for a message that quotes a file with any content."""
    return " ".join(
        part
        for part in map(str.strip, remove_control_characters(text.replace("\r", "\n")).splitlines())
        if part
    )


class OneLineError(ValueError):
    """Reports a refusal in one line, whatever the quoted file contains."""

    def __init__(self, text: str = "") -> None:
        super().__init__(join_lines(text))

    @classmethod
    def from_error(cls, error: RefusedInput) -> Self:
        """Returns the refusal of another reader as an error of this class."""
        return cls(str(error))


@dataclass(frozen=True)
class Reason:
    """Holds a sentence as in the catalogues of translations, and the values of its {names}; a value
    may be a Reason."""

    text: str
    values: Mapping[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        """Returns the sentence in English with its values."""
        return self.text.format(**self.values)


class PlaceInFile(NamedTuple):
    """Holds a place in a file: the name of the file, and the path inside it from the outside in."""

    file: str
    inside: tuple[Reason, ...] = ()

    def go_down(self, text: str, **values: object) -> PlaceInFile:
        """Returns a place one step further inside the file."""
        return self._replace(inside=(*self.inside, Reason(text, values)))

    def __str__(self) -> str:
        return ": ".join(part for part in (self.file, *map(str, self.inside)) if part)


class RefusedInput(OneLineError):
    """Reports where and why a file was refused. Its one line is for a terminal; a screen translates
    `where` and `reason`. `hint` names an option or program with which the user of a command can
    continue."""

    def __init__(
        self, where: PlaceInFile | Path | str, text: str, hint: str = "", **values: object
    ) -> None:
        self.where = where if isinstance(where, PlaceInFile) else PlaceInFile(str(where))
        self.reason, self.hint = Reason(text, values), hint
        super().__init__(
            ": ".join(part for part in (str(self.where), f"{self.reason}{hint}") if part)
        )

    @classmethod
    def from_error(
        cls, error: RefusedInput, where: PlaceInFile | Path | str | None = None, hint: str = ""
    ) -> Self:
        """Returns another refusal as an error of this class. `where` replaces its place, `hint`
        adds a hint."""
        return cls(
            error.where if where is None else where,
            error.reason.text,
            error.hint + hint,
            **error.reason.values,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns the arguments that pass the whole refusal, not only its line, to another
        process."""
        return (
            partial(type(self), self.where, self.reason.text, self.hint, **self.reason.values),
            (),
            self.__dict__,
        )

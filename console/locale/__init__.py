"""Words shown to people, by the language in use. English stands in the code; other languages in
`<language>/*.po`, a file for each part of the console.

The catalogues are read as they are, so no tool has to compile them. `_` translates now, `N_`
only marks a text that a table holds and that is translated when it is shown.

Files:

- `po`: Reads gettext's .po text
"""

from __future__ import annotations

import gettext
import os
from functools import cache
from pathlib import Path

from topdress.console.locale.po import read_po

ENGLISH = "en"
_FOLDER = Path(__file__).parent


class Catalogue(gettext.NullTranslations):
    """Translates into one language. A text that it does not hold comes back in English."""

    def __init__(self, texts: dict[str, str]) -> None:
        super().__init__()
        self.texts = texts

    def gettext(self, message: str) -> str:
        """The text in this language."""
        return self.texts.get(message) or message


@cache
def read_catalogue(language: str) -> Catalogue:
    """The catalogue of a language code such as "zh".

    Raises ValueError in one line when there is no such catalogue.
    """
    if language == ENGLISH:
        return Catalogue({})
    if language not in list_languages():
        raise ValueError(
            f"language: {language!r} is not known; allowed: {', '.join(list_languages())}"
        )
    texts: dict[str, str] = {}
    for path in sorted((_FOLDER / language).glob("*.po")):
        texts |= read_po(path.read_text(encoding="utf-8"), f"{language}/{path.name}")
    return Catalogue(texts)


@cache
def list_languages() -> tuple[str, ...]:
    """Codes of all languages that can be used, English first."""
    return (ENGLISH, *sorted({path.parent.name for path in _FOLDER.glob("*/*.po")}))


def find_preferred_language(environment: os._Environ[str] | dict[str, str] = os.environ) -> str:
    """The language that the environment asks for (LC_ALL, LC_MESSAGES, LANG), English when it is
    not known."""
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        code = environment.get(name, "").split(".")[0].split("_")[0].lower()
        if code in list_languages():
            return code
    return ENGLISH


_in_use = read_catalogue(ENGLISH)
_code = ENGLISH


def use_language(language: str) -> None:
    """Show texts in this language from now on. Raises ValueError when it is not known."""
    global _in_use, _code
    _in_use, _code = read_catalogue(language), language


def find_language_code() -> str:
    """Code of the language in use."""
    return _code


def _(message: str) -> str:
    """Return the text in the language in use; empty stays empty."""
    return _in_use.gettext(message) if message else message


def N_(message: str) -> str:
    """Mark a text for the catalogue and give it back as it is."""
    return message

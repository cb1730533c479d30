"""Translates the texts of the console into the language in use. English is in the code; other
languages are in `<language>/*.po`, one file for each part of the console.

The catalogues are read as text, so no tool has to compile them. `_` translates at once; `N_` marks
a text in a table, which is translated when it is shown.

Files:

- `po_reader`: Reads gettext's .po format
"""

from __future__ import annotations

import gettext
import os
from functools import cache
from pathlib import Path

from topdress.console.locale.po_reader import read_po

# Code of the language of the source code.
ENGLISH_CODE = "en"
_FOLDER = Path(__file__).parent


class Catalogue(gettext.NullTranslations):
    """Translates into one language. A text without translation is returned in English."""

    def __init__(self, texts: dict[str, str]) -> None:
        super().__init__()
        self.texts = texts

    def gettext(self, message: str) -> str:
        """Return the text in this language."""
        # An empty translation counts as missing: English is better than nothing.
        return self.texts.get(message) or message


@cache
def read_catalogue(language: str) -> Catalogue:
    """Return the catalogue of a language code such as "zh". Raises ValueError in one line for an
    unknown language."""
    if language == ENGLISH_CODE:
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
    """Return the codes of all available languages, English first."""
    return (ENGLISH_CODE, *sorted({path.parent.name for path in _FOLDER.glob("*/*.po")}))


def find_preferred_language(environment: os._Environ[str] | dict[str, str] = os.environ) -> str:
    """Return the language that the environment requests (LC_ALL, LC_MESSAGES, LANG), English for an
    unknown language."""
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        # A value such as zh_CN.UTF-8 begins with the code of the language.
        code = environment.get(name, "").split(".")[0].split("_")[0].lower()
        if code in list_languages():
            return code
    return ENGLISH_CODE


# The language is global state, because every text of the process is shown to the same person.
_in_use = read_catalogue(ENGLISH_CODE)
_code = ENGLISH_CODE


def use_language(language: str) -> None:
    """Show texts in this language from now on. Raises ValueError for an unknown language."""
    global _in_use, _code
    _in_use, _code = read_catalogue(language), language


def find_language_code() -> str:
    """Return the code of the language in use."""
    return _code


def _(message: str) -> str:
    """Return the text in the language in use; an empty text stays empty."""
    # The catalogue's header has the empty text as its key, so it must not be looked up.
    return _in_use.gettext(message) if message else message


def N_(message: str) -> str:
    """Mark a text for the catalogue and return it unchanged."""
    return message

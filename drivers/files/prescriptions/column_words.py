"""What the words of a column's name say that it is: a rate, an id, a size, a measurement, a unit; and its own unit."""
from __future__ import annotations

import re
import unicodedata

from drivers.files.imports.header import named
from drivers.files.imports.units import of_a_rate, unit_named
from drivers.files.imports.words import KINDS_IN_MAPS, says

SHAPEFILE_NAME = 10             # letters that a shapefile leaves of a name
BOUNDS = frozenset("min max minimum maximum mean avg default base previous prev last".split())   # no rate to be spread
RATE = sorted(word[1:] for word in dict(KINDS_IN_MAPS)["rate"] if word[0] == "=")
NUTRIENTS = {"n": "nitrogen", "nitrogen": "nitrogen", "stickstoff": "nitrogen", "azote": "nitrogen",
             "纯氮": "nitrogen", "p2o5": "P2O5", "k2o": "K2O", "phosphate": "P2O5", "potash": "K2O"}

_UNREAD = re.compile(r"[(\[{]\s*([^()\[\]{}]*/[^()\[\]{}]*?)\s*[)\]}]\s*$"
                     r"|[\s_]([^\W_]+[\s_/](?:ha|ac|acre|hectare|mu))$", re.IGNORECASE)
_SINGLE = ("mass", "share")     # quantities of which a single letter is a unit, as litres: Rate_t; no rate is in A or V


def own_unit(name: str) -> tuple[str, str | None]:
    """A column's name without the unit in it, and that unit as written, whether it is known or not."""
    plain, text = named(name)
    if text is None and of_a_rate(name):
        return "", name                 # `l/ha` is all its name
    if text is None or not of_a_rate(text):
        unread = _UNREAD.search(name)
        if unread is not None:
            return name[:unread.start()], unread[1] or unread[2]
    found = None if text is None else unit_named(text)
    if text is None or found is None or found.quantity not in ("rate", "volume", "nitrogen", "count", "mass", "share",
                                                               "flow", "other"):
        return plain, None              # `Rate_min` is no minute
    return (plain, text) if len(text) > 1 or found.quantity in _SINGLE or found.name == "l" else (name, None)


def kind_of(word: str) -> str:
    """What a word of a name says that the column is; empty: nothing."""
    return next((kind for kind, words in KINDS_IN_MAPS if says(word, words)), "")


def words_of(name: str) -> list[str]:
    """`Tgt_Rate1`, `tgtRate` and `TGT RATE` are tgt and rate; so is `TARGET_RAT`, which a shapefile has cut."""
    plain = unicodedata.normalize("NFKC", name)
    parted = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", plain).casefold()
    whole = [word for word in re.split(r"[\W_]+", parted) if word]
    words = [word if word in NUTRIENTS else re.sub(r"\d+$", "", word) or word for word in whole]
    words = [word for word in words if not word.isdigit()] or words
    words = [part for word in words                 # `nrate` is n and rate
             for part in (["n", word[1:]] if word in ("nrate", "ndose", "nmenge", "ngabe") else [word])]
    if len(name) == SHAPEFILE_NAME and words and len(words[-1]) > 1 and not kind_of(words[-1]):
        words[-1] = next((word for word in RATE if word.startswith(words[-1])), words[-1])
    return words

"""What the words of a column's name say that it is: a rate, an id, a size, a measurement, a unit; and its own unit."""
from __future__ import annotations

import re
import unicodedata

from drivers.files.imports.header import named
from drivers.files.imports.units import of_a_rate, unit_named

SHAPEFILE_NAME = 10             # letters that a shapefile leaves of a name

# Words of a name. One of `RATE` makes it a rate, unless another, or the last one, says that it is something else.
RATE = frozenset("""
    rate rates rx rx1 dose doses dosis dosen dosage dosierung tgt target targetrate tgtrate targetrat tgtrat applrate
    apprate applicationrate appliedrate appliedrat vrate vrt vra prescription prescribed prescr recommendation recomm
    recommended appl application applied menge sollmenge zielmenge aufwandmenge ausbringmenge streumenge gabe
    düngemenge duengemenge soll sollwert setpoint debit débit taux cantidad dosi norma aufwand
    """.split())
BOUNDS = frozenset("min max minimum maximum mean avg default base previous prev last".split())   # no rate to be spread
COUNTED = frozenset("""id fid oid objectid gid uid pk key idx index nr no num number nummer numero seq row col column
    code gridcode zone zones zona zonen class classes klasse clase classe cls cluster category kategorie level group grp
    rank type""".split())
SIZED = frozenset("""area areas flaeche fläche surface superficie acres acre hectare hectares hektar ha ac m2 perimeter
    length leng len shape total sum kg mass weight amount tons""".split())
MEASURED = frozenset("""ec eca ecsh ecdp conductivity cond leitfähigkeit ph om soc cec clay sand silt elev elevation
    alt altitude height slope aspect ndvi ndre ndmi evi lai yield ertrag rendement moisture feuchte date time year day
    count pixels x y lat lon latitude longitude width speed price cost seed seeds seeding planting population
    growth infiltration temperature rain erntemenge""".split())
# Chinese names have no blanks between their words.
RATE_IN = ("施肥量", "用量", "处方", "推荐量", "推荐施", "目标量", "目标施", "追肥量")
COUNTED_IN, SIZED_IN = ("编号", "序号", "等级", "类别", "分区"), ("面积", "周长", "总量")
MEASURED_IN = ("产量", "电导率", "有机质", "高程", "坡度", "水分")
RATE_ENDS = ("rate", "menge", "gabe")
NO_RATES = frozenset("nitrate substrate moderate separate corporate accurate calibrate operate carbonate "
                     "elaborate erntemenge regenmenge".split())
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
    if word in MEASURED or any(part in word for part in MEASURED_IN):
        return "a measurement"
    if word in RATE or any(part in word for part in RATE_IN) or (word.endswith(RATE_ENDS) and word not in NO_RATES):
        return "rate"
    if word in COUNTED or any(part in word for part in COUNTED_IN):
        return "a number or a class"
    return "a size" if word in SIZED or any(part in word for part in SIZED_IN) else ""


def words_of(name: str) -> list[str]:
    """`Tgt_Rate1`, `tgtRate` and `TGT RATE` are tgt and rate; so is `TARGET_RAT`, which a shapefile has cut."""
    plain = unicodedata.normalize("NFKC", name)
    parted = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", plain).casefold()
    whole = [word for word in re.split(r"[\W_]+", parted) if word]
    words = [word if word in NUTRIENTS else re.sub(r"\d+$", "", word) or word for word in whole]
    words = [word for word in words if not word.isdigit()] or words
    words = [part for word in words for part in _without_n(word)]
    if len(name) == SHAPEFILE_NAME and words and len(words[-1]) > 1 and not kind_of(words[-1]):
        words[-1] = next((word for word in sorted(RATE) if word.startswith(words[-1])), words[-1])
    return words


def _without_n(word: str) -> list[str]:
    """`nrate` is n and rate."""
    return ["n", word[1:]] if word[:1] == "n" and word[1:] in ("rate", "dose", "menge", "gabe") else [word]

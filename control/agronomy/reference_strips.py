"""Which NDVI do the N-rich strip and the farmer check have, and is their ratio plausible?"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

Doubt = Literal["", "below_1", "above_3"]

# Response index of a crop that has enough nitrogen: the strip with more of it is no greener.
INDEX_OF_NO_RESPONSE = 1.0
# Text in place of an NDVI for a strip that no longer counts.
NO_STRIP = "none"
# Sufficiency index from which a crop has enough nitrogen: below 95 % nitrogen is advised (Peterson
# et al. 1993, NebGuide G93-1171; Blackmer and Schepers 1995, J. Prod. Agric. 8:56-60). An N-rich
# strip whose ratio to the field is that close to 1 may have got no more nitrogen, or lies
# elsewhere.
ENOUGH_N_SUFFICIENCY = 0.95
# Response index above which a strip was sensed over soil or weeds, or the two strips on different
# days.
MAX_PLAUSIBLE_RESPONSE_INDEX = 3.0


class ReferenceStrips(NamedTuple):
    """Holds the NDVI of the newest pass over each strip; None where a strip is not measured."""

    nrich: float | None = None
    check: float | None = None


def calc_measured_index(strips: ReferenceStrips) -> float | None:
    """Returns the ratio of N-rich strip to farmer check as measured, without cap and line; None
    where a strip is missing."""
    if strips.nrich is None or strips.check is None:
        return None
    return strips.nrich / strips.check


def find_index_doubt(strips: ReferenceStrips) -> Doubt:
    """Returns why the measured index is not plausible; "" where it is."""
    index = calc_measured_index(strips)
    if index is None or INDEX_OF_NO_RESPONSE <= index <= MAX_PLAUSIBLE_RESPONSE_INDEX:
        return ""
    return "below_1" if index < INDEX_OF_NO_RESPONSE else "above_3"


class StripMean(NamedTuple):
    """Holds the measured NDVI of a strip, the standard error of the mean and the number of
    readings. NDVI None removes an earlier measurement."""

    which: Literal["nrich", "check"]
    ndvi: float | None
    se: float | None = None
    samples: int = 0

    @property
    def event_text(self) -> str:
        """Returns the words of an order and a log's event: `nrich 0.712 0.0041 38`, `nrich
        none`."""
        if self.ndvi is None:
            return f"{self.which} {NO_STRIP}"
        more = "" if self.se is None else f" {self.se:.4f} {self.samples}"
        return f"{self.which} {self.ndvi:.4f}{more}"


def parse_strip(text: object) -> StripMean | None:
    """Reads the words that `StripMean.event_text` writes; None where they are malformed or the
    NDVI is not in (0, 1]."""
    words = text.split() if isinstance(text, str) else []
    if words[1:] == [NO_STRIP] and words[0] in ("nrich", "check"):
        return StripMean("nrich" if words[0] == "nrich" else "check", None)
    if len(words) not in (2, 4) or words[0] not in ("nrich", "check"):
        return None
    try:
        ndvi = float(words[1])
        se = float(words[2]) if len(words) == 4 else None
        samples = int(words[3]) if len(words) == 4 else 0
    except ValueError:
        return None
    if (
        not 0.0 < ndvi <= 1.0
        or samples < 0
        or (se is not None and not (math.isfinite(se) and se >= 0.0))
    ):
        return None
    return StripMean("nrich" if words[0] == "nrich" else "check", ndvi, se, samples)

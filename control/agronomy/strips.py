"""The two strips of a field, N-rich and farmer check: how they are given, and what of their
ratio can be believed."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

Doubt = Literal["", "below_1", "above_3"]

# a strip that got more nitrogen and is no greener: the crop has enough
NO_RESPONSE = 1.0
# in the place of the NDVI of a strip that counts no more
NONE = "none"
# A crop whose reading is at least this share of the N-rich strip's has enough nitrogen: the 95
# % of the sufficiency index below which nitrogen is advised (Peterson et al. 1993, NebGuide
# G93-1171; Blackmer and Schepers 1995, J. Prod. Agric. 8:56-60). A strip hardly richer than the
# field may have got no more nitrogen, or was driven somewhere else.
HARDLY_RICHER = 0.95
# beyond it a strip was driven over soil or weeds, or the two on different days
HIGHEST_BELIEVED = 3.0


class Strips(NamedTuple):
    """NDVI of the two strips, as far as they are known; of the newest pass over them."""

    nrich: float | None = None
    check: float | None = None


def measured_index(strips: Strips) -> float | None:
    """N-rich over farmer check, neither capped nor lined; None where a strip is missing."""
    if strips.nrich is None or strips.check is None:
        return None
    return strips.nrich / strips.check


def doubt(strips: Strips) -> Doubt:
    """Why the measured index is not to be believed as it stands; "" where nothing speaks
    against it."""
    index = measured_index(strips)
    if index is None or NO_RESPONSE <= index <= HIGHEST_BELIEVED:
        return ""
    return "below_1" if index < NO_RESPONSE else "above_3"


class StripValue(NamedTuple):
    """A strip as it was measured: `se` is the standard error of the mean, `samples` how many
    readings it rests on. ndvi None: none counts any more, as before it was measured."""

    which: Literal["nrich", "check"]
    ndvi: float | None
    se: float | None = None
    samples: int = 0

    @property
    def text(self) -> str:
        """As an order and a log's event say it: `nrich 0.712 0.0041 38`, `nrich none`."""
        if self.ndvi is None:
            return f"{self.which} {NONE}"
        more = "" if self.se is None else f" {self.se:.4f} {self.samples}"
        return f"{self.which} {self.ndvi:.4f}{more}"


def read_strip(text: object) -> StripValue | None:
    """What `StripValue.text` says; None where it says nothing that can be used: NDVI in (0, 1]."""
    words = text.split() if isinstance(text, str) else []
    if words[1:] == [NONE] and words[0] in ("nrich", "check"):
        return StripValue("nrich" if words[0] == "nrich" else "check", None)
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
    return StripValue("nrich" if words[0] == "nrich" else "check", ndvi, se, samples)

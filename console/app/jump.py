"""Letters for whatever can be clicked: which letters, and which label for which place."""
from __future__ import annotations

import string
from collections.abc import Mapping, Set
from itertools import islice, product

from console.app.action import ANYWHERE, CALIBRATE, DEVICES, RUN

ACT_ON_THE_MACHINE = (ANYWHERE, RUN, DEVICES, CALIBRATE)      # their letters begin, stop or change something out there


def letters(bound: Mapping[str, Set[str]]) -> str:
    """Letters and digits for labels: none that has an action on the machine, whatever page is open, so that
    one too many does nothing there. bound: keys that have an action, by page."""
    taken = frozenset[str]().union(*(bound[where] for where in ACT_ON_THE_MACHINE))
    return "".join(one for one in string.ascii_lowercase + string.digits if one not in taken)


def labels(count: int, of: str) -> tuple[str, ...]:
    """As many as there can be of `count`, all of one length, so that none begins another."""
    if not of:
        return ()
    length = 1
    while len(of) ** length < count and length < 3:
        length += 1
    return tuple("".join(one) for one in islice(product(of, repeat=length), count))

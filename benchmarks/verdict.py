"""What a benchmark promises of its figures: `sys.exit(exit_code(promises))` at the end of every
one of them.

A benchmark that did nothing, or whose figures break a promise, must not look like one that went
well.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping


def exit_code(promises: Mapping[str, object]) -> int:
    """0 where every promise holds, else 1; each that does not is printed on stderr.

    promises: what should be so, with its limit, and whether it is. None at all: nothing was
    asked, which is no success.
    """
    broken = (
        [what for what, holds in promises.items() if not holds]
        if promises
        else ["something was measured"]
    )
    for what in broken:
        print(f"FAILED: {what}", file=sys.stderr, flush=True)
    return 1 if broken else 0

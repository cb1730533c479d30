"""How are long-lived objects kept out of the garbage collection?

Drawing leaves some 1,300 objects a second that only a collection finds (Textual's styles and
layouts). Python therefore runs a full collection every ten seconds over all living objects: pages,
their styles and their drawings. It takes 45 to 100 ms on the computer of docs/decisions/0001, a
second on a computer that is ten times slower, mostly while a dialog opens, which creates the most
objects; the console is unresponsive for that time. This module freezes the objects that survive a
collection, as `fast_imports` freezes the objects of the start, and later collections take 10 to 20
ms. A frozen object in a reference cycle is never freed, so the number of freezes is limited.
"""

from __future__ import annotations

import gc

# Number of living objects that make a freeze worthwhile: some 20 ms of a collection.
MIN_FREEZE_OBJECTS = 20_000
# Largest number of freezes: once for each page, and some more; each keeps at most 2 MB that could
# be freed.
MAX_FREEZES = 12


class FreezeSchedule:
    """Freezes the long-lived objects of a console. `freeze_after_sweep` is called often, because
    little garbage can arise between a collection and the next call."""

    def __init__(self, lives: int = MIN_FREEZE_OBJECTS) -> None:
        self.left, self._lives = MAX_FREEZES, lives
        self._seen = _count_full_sweeps()

    def freeze_after_sweep(self) -> None:
        """Freezes all living objects, if a full collection has run since the last call and enough
        objects live."""
        if self.left == 0 or self._seen == _count_full_sweeps():
            return
        self._seen = _count_full_sweeps()
        if len(gc.get_objects(generation=2)) > self._lives:
            self.left -= 1
            gc.freeze()


def _count_full_sweeps() -> int:
    """Returns the number of full collections since the process began."""
    return int(gc.get_stats()[2]["collections"])

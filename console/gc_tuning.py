"""What lives as long as the console is not swept again and again.

Drawing leaves some 1,300 objects a second that only a sweep finds (Textual's styles and
layouts), so Python sweeps every ten seconds, and with them all that lives: pages, their styles,
what was drawn of them. That takes 45 to 100 ms on the computer of docs/decisions/0001, a second
on one ten times slower, mostly while a dialog opens, which makes the most objects: the console
is silent so long. Here what is left after such a sweep is set apart, as `import_hooks` does with
what the start made, and later sweeps take 10 to 20 ms. What was set apart and is given up
later, and refers to itself, is never freed; so it is done a bounded number of times.
"""

from __future__ import annotations

import gc

# objects that are worth it: some 20 ms of a sweep
LEAST_OBJECTS = 20_000
# in all: once for each page, and some; each leaves 2 MB behind at most
MOST_FREEZES = 12


class FreezeSchedule:
    """Freezes the long-lived objects of a console. Call `freeze_after_sweep` often: between a sweep
    and the next call little can have become garbage."""

    def __init__(self, lives: int = LEAST_OBJECTS) -> None:
        self.left, self._lives = MOST_FREEZES, lives
        self._seen = _count_full_sweeps()

    def freeze_after_sweep(self) -> None:
        """Set apart all objects that are left, if a full sweep has run since the last call and
        enough live."""
        if self.left == 0 or self._seen == _count_full_sweeps():
            return
        self._seen = _count_full_sweeps()
        if len(gc.get_objects(generation=2)) > self._lives:
            self.left -= 1
            gc.freeze()


def _count_full_sweeps() -> int:
    """Number of full sweeps since the process began."""
    return int(gc.get_stats()[2]["collections"])

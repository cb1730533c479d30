"""What makes a program come up quickly: nothing is looked for that cannot be there.

Modules make much and drop little: sweeps for garbage while they are imported take a seventh of
the time and find nothing. Pydantic looks through all installed packages for plugins of its own,
of which topdress has none.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import os
from contextlib import suppress

# Settings of glibc's malloc.h: bytes freed at the end of the heap that stay, bytes from which
# on a block is not of the heap, and how many heaps there are: a thread's own keeps what another
# could use.
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
MALLOC_SETTINGS = {TRIM_THRESHOLD: 1 << 26, MMAP_THRESHOLD: 1 << 25, ARENA_MAX: 1}


def begin_imports() -> None:
    """Switch sweeps and pydantic's plugins off, before the imports."""
    gc.disable()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def end_imports() -> None:
    """Set apart all objects that are there, and switch sweeps on again, once the program runs."""
    gc.freeze()
    gc.enable()


def collect_seldom() -> None:
    """Make sweeps a hundred times rarer, before a long computation that leaves little garbage.

    Objects that are there already are not swept again. A simulated run takes a tenth less; so do
    the imports of a diagnosis.

    Memory that arrays leave stays for the arrays that follow: glibc gives 0.2 MB back each time,
    and the kernel clears it anew: half of all page faults of a diagnosis of 24,000 rows, 8 % of its
    time. Other C libraries have no `mallopt`.

    At the end nothing is swept: the memory of a process ends with it (0.15 s of a diagnosis).
    """
    gc.freeze()
    atexit.register(gc.freeze)
    gc.set_threshold(70_000, 10, 10)
    with suppress(AttributeError, OSError, TypeError):
        mallopt = ctypes.CDLL(None).mallopt
        for knob, value in MALLOC_SETTINGS.items():
            mallopt(knob, value)

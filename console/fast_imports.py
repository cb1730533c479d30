"""How does a program start quickly? It skips searches whose result is known to be empty.

Imports create many objects and drop few, so garbage collections during imports take a seventh of
the time and find nothing. Pydantic searches all installed packages for its plugins, of which
topdress has none.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import os
from contextlib import suppress

# Parameters of glibc's malloc.h: free bytes that stay at the end of the heap, size from which a
# block is mapped separately, and number of heaps, because a thread's own heap keeps memory that
# other threads could use.
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
MALLOC_SETTINGS = {TRIM_THRESHOLD: 1 << 26, MMAP_THRESHOLD: 1 << 25, ARENA_MAX: 1}


def pause_gc_for_imports() -> None:
    """Switches garbage collection and pydantic's plugins off, before the imports."""
    gc.disable()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def resume_gc() -> None:
    """Freezes all existing objects, and switches garbage collection on again, once the program
    runs."""
    gc.freeze()
    gc.enable()


def make_gc_rare() -> None:
    """Makes garbage collections a hundred times rarer, before a long computation that leaves little
    garbage.

    Existing objects are not collected again. A simulated run takes a tenth less time, and so do the
    imports of a diagnosis.

    Memory of freed arrays stays in the process for later arrays. Otherwise glibc returns 0.2 MB
    each time and the kernel clears them again, which causes half of all page faults of a diagnosis
    of 24,000 rows, 8 % of its time. Other C libraries have no `mallopt`.

    No collection runs at the end, because the memory of a process ends with it (0.15 s of a
    diagnosis).
    """
    gc.freeze()
    atexit.register(gc.freeze)
    gc.set_threshold(70_000, 10, 10)
    with suppress(AttributeError, OSError, TypeError):
        mallopt = ctypes.CDLL(None).mallopt
        for knob, value in MALLOC_SETTINGS.items():
            mallopt(knob, value)

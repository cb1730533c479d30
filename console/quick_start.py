"""What makes a program come up quickly: nothing is looked for that cannot be there.

Modules make much and drop little: sweeps for garbage while they are imported take a seventh of the time and find
nothing. Pydantic looks through all installed packages for plugins of its own, of which topdress has none.
"""
from __future__ import annotations

import gc
import os


def begin() -> None:
    """Before the imports."""
    gc.disable()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def done() -> None:
    """Once it runs: what is there now stays, and is not swept again."""
    gc.freeze()
    gc.enable()


def seldom() -> None:
    """Before a long computation that leaves little garbage: what is there is not swept again, and what comes is swept a
    hundred times more seldom. A simulated run takes a tenth less; so do the imports of a diagnosis."""
    gc.freeze()
    gc.set_threshold(70_000, 10, 10)

"""What a diagnosis does where its own numbers fail: what cannot be judged is left out and said, all else is judged.

A log may be so odd that a matrix has no inverse or a sum no value. That is trouble of the program's own, never "what
was given is wrong", and it must not take the other channels with it.
"""
from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass
from pathlib import PurePath
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


class Cancelled(Exception):
    """The diagnosis was asked to end."""


def attempt(what: str, work: Callable[[], T], findings: list[str]) -> T | None:
    """What `work` gives; None where it fails, and a sentence on `what` among the findings.

    Numbers that overflow or vanish on the way raise no warning: what comes of them is looked at (`is_finite`). Whatever
    fails is caught, for nobody knows beforehand what a stranger's log makes of a formula; the place stands in the
    sentence, so that it can be reported.
    """
    try:
        with np.errstate(all="ignore"):
            return work()
    except Cancelled:
        raise
    except Exception as error:
        findings.append(f"{what}: left out: the program's own arithmetic fails on this log "
                        f"({type(error).__name__} at {_place(error)}; please report it)")
        return None


def _place(error: Exception) -> str:
    """File and line of ours that the error came from."""
    trace, found = error.__traceback__, "?"
    while trace is not None:
        path = PurePath(trace.tb_frame.f_code.co_filename)
        if "control" in path.parts:
            found = f"{path.name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return found


def is_finite(value: Any) -> bool:
    """Whether every number in a result is one."""
    if isinstance(value, float):
        return math.isfinite(value)
    if is_dataclass(value):
        return all(is_finite(getattr(value, one.name)) for one in fields(value))
    if isinstance(value, dict):
        return all(map(is_finite, value.values()))
    return all(map(is_finite, value)) if isinstance(value, list | tuple) else True


def named(channels: Iterable[str]) -> str:
    """Channels as a sentence names them."""
    found = list(channels)
    return found[0] if len(found) == 1 else f"{', '.join(found[:-1])} and {found[-1]}"

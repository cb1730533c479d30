"""What is written down about a case: its hidden causes, and how much of the error an answer
takes away."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .nominal import IDS, Effect
from .programmes import Drive

Floats = npt.NDArray[np.float64]
Columns = dict[str, npt.NDArray[Any]]
Share = Callable[[Sequence[dict[str, Any]]], float | None]


class Changed(NamedTuple):
    """Without noise, by reading (rows,): what is `hidden` changes, and what this machine's
    `tolerance` does, each stage asked with what the stages before it truly did. Readings:
    shaft, gate, scale, wheel, gnss, heads."""

    hidden: dict[str, Floats]
    tolerance: dict[str, Floats]


class Redrive(NamedTuple):
    """The same hidden machine on another drive."""

    columns: Columns
    truth: dict[str, Any]
    changed: Callable[[], Changed]


# drive -> changed drive, seed of the noise (None: that of the first run)
Redriven = Callable[[Callable[[Drive], Drive], int | None], Redrive]
# kind of data, columns, truth, share of gain
Made = tuple[str, Columns, dict[str, Any], Share, Redriven | None]

# likeness of two traces from which on the data cannot tell them apart
EQUAL = 0.99
# what must be left of an effect after its rival to be told from it
SEPARABLE_Z = 3.0


class Relations:
    """Collects the ids that leave the same trace as an effect of detectability `z`, and those
    too like it."""

    def __init__(self, z: float) -> None:
        self._z = z
        self._equal: dict[str, float] = {}
        self._near: dict[str, float] = {}

    def add(self, name: str, like: float) -> None:
        """`like`: cosine of the two traces after the nuisances, of the sign that the rival
        allows."""
        if like > EQUAL:
            self._equal[name] = max(self._equal.get(name, 0.0), round(float(like), 4))
        elif like > 0.5 and self._z * np.sqrt(1 - like * like) < SEPARABLE_Z:
            self._near[name] = max(self._near.get(name, 0.0), round(float(like), 4))

    def told(self) -> dict[str, Any]:
        return {
            "equal": self._equal,
            "near": {k: v for k, v in self._near.items() if k not in self._equal},
        }


def told(e: Effect, z: float, r: dict[str, Any], span: dict[str, float]) -> dict[str, Any]:
    """`size_defined`: the data reach the place where the catalogue defines the size, so its
    interval can be judged."""
    defined = {
        "flow.fill_falloff": span["shaft_high_rpm"] >= 85.0,
        "shaft.load_droop": span["opening_high_mm"] >= 50.0,
        "flow.hopper_head": e.form % 3 == 0,
    }.get(e.id, True)
    return {
        "id": e.id,
        "size": e.size,
        "unit": IDS[e.id].unit,
        "onset_s": e.onset_s,
        "member": e.member,
        "form": e.form,
        "knob": e.knob,
        "seed": e.seed,
        "z": round(z, 3),
        "size_defined": bool(defined),
        **r,
    }


def share_of(
    planted: tuple[Effect, ...],
    trace: Callable[[Sequence[Effect]], Floats],
    inner: Callable[[Floats, Floats], float],
) -> Share:
    """Takes the named causes, as sized, off the data again: 1 - left / removable, in whitened
    squares."""

    def share(causes: Sequence[dict[str, Any]]) -> float | None:
        if not planted:
            return None
        named = []
        for c in causes:
            if c["id"] not in IDS or c["size"]["value"] is None:
                return None
            like = next((e for e in planted if e.id == c["id"]), Effect(c["id"], 0.0))
            onset = (
                c["onset_s"]
                if c["onset_s"] is not None
                else c["size"]["value"]
                if c["id"] in ("shaft.stall", "gate.stuck")
                else like.onset_s
            )
            named.append(
                like._replace(
                    size=float(c["size"]["value"]), onset_s=onset, member=c["member"] or like.member
                )
            )
        there = trace(planted)
        left = there - trace(named)
        removable = inner(there, there)
        # a coarse clock removes nothing
        return 1.0 - inner(left, left) / removable if removable > 1e-9 else None

    return share

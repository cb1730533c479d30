"""The machine file with what a diagnosis found: simulated, predicted and compensated from then on."""
from __future__ import annotations

from collections.abc import Mapping

from control.machine.machine import CATALOGUE, Adopted, Machine, with_effect
from control.machine.planting import Planted

from .result import Cause, Diagnosis


def extend(machine: Machine, diagnosis: Diagnosis, *, date: str = "", sha256: str = "",
           valid: Mapping[str, tuple[float, float]] | None = None) -> Machine:
    """The machine with the named causes adopted.

    A smooth dependence that no effect explains is not: neither plant nor control would evaluate it.

    date : as it shall stand in the file; sha256 : of the data; valid : range by recorded variable in which the
    extension may be believed (default: the ranges that the diagnosis saw excited). Effects that begin mid-run (a
    blocked outlet, a stall) are repaired, not modelled: they are left out. Raises ValueError for a size out of bounds.
    """
    ranges = dict(diagnosis.excited if valid is None else valid)
    adopted = list(machine.adopted)
    for cause in adoptable(diagnosis):
        assert cause.size.value is not None
        machine = with_effect(machine, cause.id, _total(machine, cause), cause.member)
        adopted.append(Adopted(id=cause.id, size=cause.size.value, low=cause.size.low, high=cause.size.high,
                               unit=cause.size.unit, member=cause.member, data=diagnosis.data.path, sha256=sha256,
                               date=date, valid=ranges))
    return machine.model_copy(update={"adopted": tuple(adopted)})


def adoptable(diagnosis: Diagnosis) -> tuple[Cause, ...]:
    """Causes that can be modelled from the start of a run: those with a size, and without an onset."""
    return tuple(c for c in diagnosis.causes if not CATALOGUE[c.id].effect.onset_only and c.onset_s is None
                 and c.size.value is not None)


def refuse_to_adopt(cause: Cause) -> None:
    """Raises ValueError where an effect holds for one label or one table only (its scope), not for the machine."""
    if cause.scope is not None:
        raise ValueError(f"{cause.id}: holds for {cause.scope} only, not for the machine: it is not adopted; diagnose "
                         "that data by itself to adopt what it shows")


def planted(machine: Machine, diagnosis: Diagnosis) -> tuple[Planted, ...]:
    """The adoptable causes as effects of a simulated `machine`, on top of what its file has of them already."""
    return tuple(Planted(c.id, _total(machine, c), 0.0, c.member) for c in adoptable(diagnosis))


def _total(machine: Machine, cause: Cause) -> float:
    entry = CATALOGUE[cause.id]
    before = getattr(getattr(machine, entry.stage), entry.field) - entry.neutral
    return float(min(entry.high - entry.neutral, max(entry.low - entry.neutral, before + (cause.size.value or 0.0))))

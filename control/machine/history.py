"""Which changes did a machine file have, and how is the last one undone?"""

from __future__ import annotations

from collections.abc import Iterator

from .machine import CATALOGUE, Change, Machine, Resized


def append_history(
    before: Machine, after: Machine, *, data: str = "", sha256: str = "", date: str = ""
) -> Machine:
    """Returns `after` with the changed effects and terms appended to its history."""
    had = {term.id for term in before.terms}
    change = Change(
        date=date,
        data=data,
        sha256=sha256,
        effects=tuple(_find_resized(before, after)),
        terms=tuple(term for term in after.terms if term.id not in had),
    )
    return after.model_copy(update={"history": (*after.history, change)})


def find_last_change(machine: Machine) -> Change | None:
    """Returns the newest change that was not undone."""
    return next((one for one in reversed(machine.history) if not one.undone), None)


def undo_last_change(machine: Machine, *, date: str = "") -> Machine:
    """Returns the machine with its last change undone; the history keeps the change with the day of
    the undoing.

    An effect that was changed by hand since keeps that change: only the undone change is
    subtracted.

    Raises
    ------
    ValueError : no change is left to undo.
    """
    last = find_last_change(machine)
    if last is None:
        raise ValueError(
            f"machine {machine.id}: history: nothing to take back: only what a diagnosis "
            "changed is there"
        )
    found = machine
    for one in last.effects:
        entry = CATALOGUE[one.id]
        stage = getattr(found, entry.stage)
        size = getattr(stage, entry.field) - entry.neutral
        back = one.before if abs(size - one.after) < 1e-9 else size - (one.after - one.before)
        found = found.model_copy(
            update={entry.stage: stage._replace(**{entry.field: entry.neutral + back})}
        )
    taken = {term.id for term in last.terms}
    came = (last.data, last.sha256, last.date)
    ids = {one.id for one in last.effects}
    marked = last.model_copy(update={"undone": date or "undone"})
    return found.model_copy(
        update={
            "terms": tuple(term for term in found.terms if term.id not in taken),
            "adopted": tuple(
                one
                for one in found.adopted
                if not (one.id in ids and (one.data, one.sha256, one.date) == came)
            ),
            "history": tuple(marked if one is last else one for one in found.history),
        }
    )


def _find_resized(before: Machine, after: Machine) -> Iterator[Resized]:
    """Yields the effects with different sizes."""
    for effect_id, entry in CATALOGUE.items():
        old, new = (
            getattr(getattr(one, entry.stage), entry.field) - entry.neutral
            for one in (before, after)
        )
        if old != new:
            field = entry.effect.member_field
            member = int(getattr(getattr(after, entry.stage), field)) if field else None
            yield Resized(id=effect_id, member=member, before=old, after=new)

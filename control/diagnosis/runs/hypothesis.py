"""A hypothesis: effects with sizes, and the machine's stages as they are under it."""

from __future__ import annotations

from typing import Any, NamedTuple

from topdress.control.machine.machine import CATALOGUE, STAGES, Machine

# parameter sets of one run are compiled for this many beginnings and ends
MAX_SWITCHES = 5


class EffectInstance(NamedTuple):
    """One hypothesised effect. `size` in its catalogue unit (1 for an effect whose size is its
    onset).

    onset_s : when it begins; None: it was there all along. until_s : when it ends; None: not in
    this log. grows : from nothing at its onset, evenly, to `size` at the end of the log; else
    it is there at once.
    """

    id: str
    size: float
    onset_s: float | None = None
    member: int | None = None
    until_s: float | None = None
    grows: bool = False

    @property
    def switches(self) -> tuple[float, ...]:
        """Times at which a run of the model has other parameters for it."""
        return (
            ()
            if self.grows
            else tuple(t for t in (self.onset_s, self.until_s) if t is not None and t > 0.0)
        )


Hypothesis = tuple[EffectInstance, ...]


def replace_part(parts: Hypothesis, k: int, part: EffectInstance) -> Hypothesis:
    """A hypothesis with another part in place k."""
    return (*parts[:k], part, *parts[k + 1 :])


def remove_part(parts: Hypothesis, k: int) -> Hypothesis:
    """A hypothesis without its part in place k."""
    return (*parts[:k], *parts[k + 1 :])


class Stages(NamedTuple):
    """Parameter tuples of the stages in force, by stage name."""

    by_name: dict[str, Any]

    def put(self, stage: str, **changes: Any) -> Stages:
        return Stages({**self.by_name, stage: self.by_name[stage]._replace(**changes)})


def list_stages(machine: Machine) -> Stages:
    return Stages({name: getattr(machine, name) for name in STAGES})


def add_part(stages: Stages, part: EffectInstance) -> Stages:
    """Stages with one more effect on top of what they have; no bounds are looked at."""
    entry = CATALOGUE[part.id]
    before = getattr(stages.by_name[entry.stage], entry.field)
    changes: dict[str, float] = {entry.field: float(before + part.size)}
    if entry.effect.member_field:
        changes[entry.effect.member_field] = float(part.member or 1)
    return stages.put(entry.stage, **changes)


class Schedule(NamedTuple):
    """Stage sets in the order in which they come into force; `from_s[j]` is when set j+1 does."""

    sets: tuple[Stages, ...]
    from_s: tuple[float, ...]


def make_schedule(stages: Stages, parts: Hypothesis) -> Schedule:
    """When which stages are in force under a hypothesis; what grows is left out
    (`GroupModel.run` has it).

    Raises ValueError for too many beginnings and ends.
    """
    times = sorted({time_s for part in parts for time_s in part.switches})
    if len(times) > MAX_SWITCHES:
        raise ValueError(f"hypothesis with {len(times)} onsets: at most {MAX_SWITCHES} are allowed")
    sets = []
    for begin in (0.0, *times):
        now = stages
        for part in parts:
            started = part.onset_s is None or part.onset_s <= begin
            if started and not part.grows and (part.until_s is None or begin < part.until_s):
                now = add_part(now, part)
        sets.append(now)
    return Schedule(tuple(sets), tuple(times))

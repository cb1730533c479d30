"""Defines a hypothesis: effects with sizes, and the parameters of the machine's stages under the
hypothesis.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from topdress.control.machine.machine import CATALOGUE, STAGES, Machine

# Maximum number of parameter changes in a run: the compiled model has an array of this length.
MAX_SWITCHES = 5


class EffectInstance(NamedTuple):
    """A hypothesised effect. `size` is in its catalogue unit (1 for an effect whose size is its
    onset).

    onset_s : time of the begin; None for an effect of the whole log. until_s : time of the end;
    None for no end in this log. grows : whether the effect grows evenly from zero at its onset to
    `size` at the end of the log; otherwise it is a step.
    """

    id: str
    size: float
    onset_s: float | None = None
    member: int | None = None
    until_s: float | None = None
    grows: bool = False

    @property
    def switches(self) -> tuple[float, ...]:
        """Times at which the model's parameters change because of the effect, s."""
        return (
            ()
            if self.grows
            else tuple(t for t in (self.onset_s, self.until_s) if t is not None and t > 0.0)
        )


Hypothesis = tuple[EffectInstance, ...]


def replace_part(parts: Hypothesis, k: int, part: EffectInstance) -> Hypothesis:
    """Return a hypothesis with another effect at index k."""
    return (*parts[:k], part, *parts[k + 1 :])


def remove_part(parts: Hypothesis, k: int) -> Hypothesis:
    """Return a hypothesis without its effect at index k."""
    return (*parts[:k], *parts[k + 1 :])


class StageParams(NamedTuple):
    """Parameter tuples of the stages, by stage name."""

    by_name: dict[str, Any]

    def replace_fields(self, stage: str, **changes: Any) -> StageParams:
        return StageParams({**self.by_name, stage: self.by_name[stage]._replace(**changes)})


def list_stages(machine: Machine) -> StageParams:
    return StageParams({name: getattr(machine, name) for name in STAGES})


def add_part(stages: StageParams, part: EffectInstance) -> StageParams:
    """Return the stages with a further effect added to their parameters; bounds are not checked."""
    entry = CATALOGUE[part.id]
    before = getattr(stages.by_name[entry.stage], entry.field)
    changes: dict[str, float] = {entry.field: float(before + part.size)}
    if entry.effect.member_field:
        changes[entry.effect.member_field] = float(part.member or 1)
    return stages.replace_fields(entry.stage, **changes)


class Schedule(NamedTuple):
    """Sets of stages in the order in which they come into force; `from_s[j]` is the start of set
    j+1, s."""

    sets: tuple[StageParams, ...]
    from_s: tuple[float, ...]


def make_schedule(stages: StageParams, parts: Hypothesis) -> Schedule:
    """Return the times at which each set of stages is in force under a hypothesis. Growing effects
    are left out, because `GroupModel.run` adds them.

    Raises ValueError for too many begins and ends.
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

"""The smallest size of each effect that a log would have shown."""
from __future__ import annotations

import numpy as np

from control.diagnosis.effects import ROWS
from control.diagnosis.result import Detectable, NotShown
from control.machine.machine import CATALOGUE

from .likelihood import projected
from .nuisances import tolerance_of
from .selection import THRESHOLD, Named


def not_shown(one: Named) -> list[NotShown]:
    """Smallest size at which an effect that is not named would have passed the threshold (Fisher information)."""
    group, now = one.group, one.found
    named = {p.id for p in now.parts}
    best: dict[str, float] = {}
    kept = [c for c in group.candidates if c.part.id not in named]
    columns = [group.candidate_column(now.parts, c) for c in kept]
    p, before = group.compressed(now.parts, columns)
    normal, _ = projected(p, np.arange(before), now.noise)
    for k, candidate in enumerate(kept):
        stiff = normal[before + k, before + k]
        effect_id = candidate.part.id
        if CATALOGUE[effect_id].effect.onset_only or stiff <= 0.0:
            continue
        size = float(np.sqrt(THRESHOLD * (1.0 / stiff + tolerance_of(effect_id, group.machine) ** 2)))
        if ROWS[effect_id].threshold:
            size = abs(candidate.part.size) if size <= abs(candidate.part.size) else np.inf
        if ROWS[effect_id].ladder and size > abs(candidate.part.size) * 2.0:
            continue
        if effect_id not in best or size < best[effect_id]:
            best[effect_id] = size
    found = []
    for effect_id in dict.fromkeys(c.part.id for c in kept):
        entry = CATALOGUE[effect_id]
        size = best.get(effect_id, np.inf)
        most = max(abs(entry.low - entry.neutral), abs(entry.high - entry.neutral))
        found.append(NotShown(effect_id, Detectable(size if size <= most else None, entry.effect.unit)))
    return found

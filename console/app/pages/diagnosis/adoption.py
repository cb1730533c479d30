"""Selects the causes that a machine file adopts with an Enter, and those that the operator must
pick by name.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations

from topdress.console.app.pages.diagnosis.service import AdoptionOffer, DiagnosisView
from topdress.console.reports import diagnosis_wording
from topdress.control.diagnosis.result import Cause

# Up to this number of undecided causes, any combination may be picked; with more causes only one at
# a time, because every combination is prepared in advance.
MAX_COMBINED_CAUSES = 4


def list_undecided(found: DiagnosisView) -> tuple[Cause, ...]:
    """Return the causes that could be adopted but are undecided: the data cannot separate them from
    others, or they are only suspected."""
    return tuple(
        one
        for one in found.found.causes
        if one.id in found.adoptable and diagnosis_wording.is_undecided(one)
    )


def list_decided_ids(found: DiagnosisView) -> tuple[str, ...]:
    """Return the ids that an Enter adopts."""
    open_ = {one.id for one in list_undecided(found)}
    return tuple(one for one in found.adoptable if one not in open_)


def merge_picked_ids(found: DiagnosisView, picked: tuple[str, ...]) -> tuple[str, ...]:
    """Return the ids of decided and picked causes, in the order of the diagnosis."""
    return tuple(one for one in found.adoptable if one in list_decided_ids(found) or one in picked)


def list_selections(found: DiagnosisView) -> Iterator[tuple[str, ...]]:
    """Yield every set of ids that the operator can choose; each gives one machine file."""
    names = tuple(dict.fromkeys(one.id for one in list_undecided(found)))
    most = len(names) if len(names) <= MAX_COMBINED_CAUSES else 1
    for picked in chain.from_iterable(combinations(names, count) for count in range(most + 1)):
        ids = merge_picked_ids(found, picked)
        if ids:
            yield ids


def find_offer(found: DiagnosisView, ids: tuple[str, ...]) -> AdoptionOffer | None:
    """Return the machine file that adopts these ids, or None."""
    return next((one for one in found.offers if set(one.ids) == set(ids)), None)

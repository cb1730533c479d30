"""What of a diagnosis a machine file takes up with an Enter, and what only where the operator
picks it by name."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations

from topdress.console.app.pages.diagnosis.service import AdoptionOffer, DiagnosisView
from topdress.console.reports import diagnosis_wording
from topdress.control.diagnosis.result import Cause

# undecided causes of which any may be picked together; of more, one at a time
MOST_COMBINED = 4


def list_undecided(found: DiagnosisView) -> tuple[Cause, ...]:
    """Causes that could be adopted and are not decided: the data cannot separate them from others,
    or they are only suspected."""
    return tuple(
        one
        for one in found.found.causes
        if one.id in found.adoptable and diagnosis_wording.is_undecided(one)
    )


def list_sure(found: DiagnosisView) -> tuple[str, ...]:
    """Ids that are adopted with an Enter."""
    open_ = {one.id for one in list_undecided(found)}
    return tuple(one for one in found.adoptable if one not in open_)


def merge_picked(found: DiagnosisView, picked: tuple[str, ...]) -> tuple[str, ...]:
    """Ids of sure and picked causes, in their order."""
    return tuple(one for one in found.adoptable if one in list_sure(found) or one in picked)


def list_selections(found: DiagnosisView) -> Iterator[tuple[str, ...]]:
    """Every set of ids that the operator can choose: one machine file each."""
    names = tuple(dict.fromkeys(one.id for one in list_undecided(found)))
    most = len(names) if len(names) <= MOST_COMBINED else 1
    for picked in chain.from_iterable(combinations(names, count) for count in range(most + 1)):
        ids = merge_picked(found, picked)
        if ids:
            yield ids


def find_offer(found: DiagnosisView, ids: tuple[str, ...]) -> AdoptionOffer | None:
    """The machine file that adopts these; None where there is none."""
    return next((one for one in found.offers if set(one.ids) == set(ids)), None)

"""What a change did to a machine file, before and after, a line for each effect and term."""
from __future__ import annotations

from console.locale import _
from console.reports.term_words import sentence
from control.machine.machine import CATALOGUE, Change


def side_by_side(change: Change) -> list[str]:
    """Each effect and term before and after."""
    lines = [f"  {one.id}{'' if one.member is None else f'#{one.member}'}: {one.before:.4g} -> {one.after:.4g} "
             f"{CATALOGUE[one.id].effect.unit}" for one in change.effects]
    terms = [f"  {term.id}: {_('none')} -> {sentence(term.model_dump(mode='json'))}" for term in change.terms]
    return [*lines, *terms]

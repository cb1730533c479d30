"""Which forms of the published list (docs/terms.md) say what a hidden term does: its family."""

from __future__ import annotations

from typing import Any

# straight lines between nodes say any dependence of one variable
LAST_RESORT = "table"
# class -> forms that say it; of a class with several shapes one set for each remainder of the
# hidden form's number
_BY_CLASS: dict[str, tuple[frozenset[str], ...]] = {
    "variable": (
        frozenset({"hinge", "bend", "dead_zone"}),  # |u|
        frozenset({"bend", "hinge"}),  # u^2 - 1
        frozenset({"bend", "hinge"}),  # a bump
        frozenset({"threshold", "saturation", "side"}),  # a step
        frozenset({"slope", "dead_zone", "hinge"}),  # u^3
        frozenset({"bend", "hinge", "slope", "saturation"}),
    ),  # a wave
    "product": (frozenset({"product"}),),
    "memory": (frozenset({"memory"}),),
    "periodic": (frozenset({"periodic"}),),
    # the second: a constant lost
    "dead_zone": (frozenset({"dead_zone"}), frozenset({"saturation", "threshold"})),
    "saturation": (frozenset({"saturation"}), frozenset({"hinge", "saturation", "dead_zone"})),
    # of a place, of a way to move
    "side": (frozenset({"side", "threshold", "saturation"}), frozenset({"side"})),
    "span": (frozenset({"span"}),),
    "column": (
        frozenset({"slope"}),
        frozenset({"saturation", "slope"}),
        frozenset({"bend", "hinge"}),
        frozenset({"bend", "hinge"}),
    ),
}
_TABLE_SAYS = {"variable", "dead_zone", "saturation", "column"}


def family(term: dict[str, Any]) -> frozenset[str]:
    """Forms that are right for a hidden term (`truth["outside"]["term"]`)."""
    sets = _BY_CLASS[term["kind"]]
    forms = sets[term["form"] % len(sets)]
    return forms | {LAST_RESORT} if term["kind"] in _TABLE_SAYS else forms

"""How is the catalogue of effects written as a page of documentation? It is generated from the
parameters.
"""

from __future__ import annotations

from collections.abc import Mapping

from topdress.control.machine.effect import CatalogueEntry
from topdress.control.machine.machine import (
    NOMINAL_MACHINE,
    Machine,
    describe_unit,
    find_size_bounds,
)

PAGE_HEAD = """# Effects

For engineers who read a diagnosis or simulate an effect: all faults in the machine model, how each
shows, and its remedy.

Each effect is one parameter of one stage; its neutral value switches it off. A diagnosis searches
for it, `topdress simulate --effect ID=SIZE` simulates it, and a machine file can adopt it. If data
cannot show an effect, the diagnosis lists it as not shown.

`topdress effects --markdown docs/effects.md` writes this page. Ranges are those of machine `{id}`.
A range "by" a figure of the machine file grows with it (`topdress effects --machine FILE`). "Test"
separates look-alikes.
"""
STAGE_TITLES = {
    "shaft": "Metering shaft",
    "gate": "Gate (opening)",
    "flow": "Flow out of the hopper",
    "scale": "Hopper scale",
    "speed": "Ground speed",
    "heads": "Canopy heads",
    "fall": "Lag and place",
    "effort": "How hard the drives work",
}

MEMBER_NAMES = {"heads": "head", "flow": "outlet"}


def format_effects_page(
    catalogue: Mapping[str, CatalogueEntry], machine: Machine = NOMINAL_MACHINE
) -> str:
    """Returns the page: the ids of each stage, then each effect, in the order of the catalogue."""
    stages = list(dict.fromkeys(entry.stage for entry in catalogue.values()))
    lines = [PAGE_HEAD.format(id=machine.id).rstrip("\n")]
    for stage in stages:
        lines += ["", f"## {STAGE_TITLES.get(stage, stage)}"]
        for entry in catalogue.values():
            if entry.stage == stage:
                lines += _format_effect(entry, machine)
    return "\n".join(lines) + "\n"


def _format_effect(entry: CatalogueEntry, machine: Machine) -> list[str]:
    effect = entry.effect
    member = (
        f", with the number of the {MEMBER_NAMES.get(entry.stage, 'member')}"
        if effect.member_field
        else ""
    )
    size = f"{describe_unit(effect.id, machine)}; {_format_range(entry, machine)}"
    if effect.onset_only:
        size += "; the size is the time at which it begins"
    return [
        "",
        f"### {effect.id}",
        "",
        f"**{effect.title}.** {effect.physics}",
        "",
        f"- Unit: {size}{member}. Found in: {', '.join(effect.seen_in)}.",
        f"- Remedy: {effect.advice}",
        f"- Test: {effect.separate}",
        f"- Source: {effect.source}",
    ]


def _format_range(entry: CatalogueEntry, machine: Machine) -> str:
    if entry.effect.onset_only:
        return "at any time"
    low, high = find_size_bounds(entry.effect.id, machine)
    shares = " x ".join(entry.effect.scales_with)
    return f"{low:g} to {high:g}" + (f", by {shares}" if shares else "")

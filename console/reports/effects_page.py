"""The catalogue of effects as a page of documentation: read off the parameters, never written
by hand."""

from __future__ import annotations

from collections.abc import Mapping

from control.machine.effect import Entry
from control.machine.machine import NOMINAL, Machine, bounds, unit_of

HEAD = """# Effects

Everything that the machine model knows how to get wrong. Each effect is one parameter of one
stage, switched off by its neutral value; diagnosis looks for it, `topdress simulate --effect
ID=SIZE` plants it, an adopted machine file carries it.
An effect is judged only on data where it can be seen; elsewhere a diagnosis lists it as not shown.

This page is written by `topdress effects --markdown docs/effects.md`; change the parameters, not
the page.
"""
WHOSE = """
Ranges are those of machine `{id}`. Where one is a share of figures of the machine file,
`topdress effects --machine FILE` gives another machine's.
"""
STAGES = {
    "shaft": "Metering shaft",
    "gate": "Gate (opening)",
    "flow": "Flow out of the hopper",
    "scale": "Hopper scale",
    "speed": "Ground speed",
    "heads": "Canopy heads",
    "fall": "Lag and place",
    "effort": "How hard the drives work",
}


def markdown(catalogue: Mapping[str, Entry], machine: Machine = NOMINAL) -> str:
    """The page: a table of all ids, then each effect by stage, in the order of the catalogue."""
    lines = [
        HEAD + WHOSE.format(id=machine.id),
        "| id | what happens | size in | range | seen in |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| [{e.effect.id}](#{_anchor(e)}) | {_cell(e.effect.title)} | "
        f"{_cell(unit_of(e.effect.id, machine))} | "
        f"{_range(e, machine)} | {_cell(', '.join(e.effect.seen_in))} |"
        for e in catalogue.values()
    ]
    for stage in dict.fromkeys(entry.stage for entry in catalogue.values()):
        lines += ["", f"## {STAGES.get(stage, stage)}"]
        for entry in catalogue.values():
            if entry.stage == stage:
                lines += _effect(entry, machine)
    return "\n".join(lines) + "\n"


def _effect(entry: Entry, machine: Machine) -> list[str]:
    effect = entry.effect
    which = (
        {"heads": "head", "flow": "outlet"}.get(entry.stage, "member")
        if effect.member_field
        else ""
    )
    size = f"{unit_of(effect.id, machine)}; {_range(entry, machine)}"
    if effect.onset_only:
        size += "; the size is the time at which it begins"
    return [
        "",
        f"### {effect.id}",
        "",
        f"**{effect.title}.** {effect.physics}",
        "",
        f"- Size: {size}" + (f"; with the number of the {which}" if which else ""),
        f"- Seen in: {', '.join(effect.seen_in)}",
        f"- For the owner: {' '.join(effect.says).format(size='(size)')}",
        f"- What to do: {effect.advice}",
        f"- Separated from its look-alikes by: {effect.separate}",
        f"- Source: {effect.source}",
    ]


def _anchor(entry: Entry) -> str:
    """As the usual renderers make it of a heading: points vanish."""
    return entry.effect.id.replace(".", "")


def _range(entry: Entry, machine: Machine) -> str:
    if entry.effect.onset_only:
        return "at any time"
    low, high = bounds(entry.effect.id, machine)
    shares = " x ".join(entry.effect.scales_with)
    return f"{low:g} to {high:g}" + (f", a share of {shares}" if shares else "")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")

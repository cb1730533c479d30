"""Entries of the examination, each one function: `diagnose(data, machine)`.

data : path of log.csv or bench.csv; kind.txt in its folder says run or which table. machine : path
of machine.yaml. Both lie in a fresh copy of the case, where the entry may write; it is gone after
the answer was scored. The answer is a dictionary:

    causes    {effect id: probability that it is there}
    none      probability that nothing is wrong
    unknown   probability of a cause that is on no list
    size      {effect id: [5 %, 50 %, 95 %] of its size}
    onset_s   {effect id: s, or None}; may be left out
    machine   path of a machine file that predicts this machine, or None

Other packages enter by an entry point of the group `topdress.examination`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

Answer = dict[str, Any]
Entry = Callable[[Path, Path], Answer]
GROUP = "topdress.examination"
# Shares of the training cases that the constant says without a trained file (learn.py).
CONSTANT = {"none": 0.36, "unknown": 0.17}
CONSTANT_ID = 0.010
TRAINED = Path(__file__).resolve().parents[2] / ".benchmarks" / "examination" / "trained"


def diagnose_constant(data: Path, machine: Path) -> Answer:
    """Says the shares of the training cases, whatever the data."""
    from topdress.control.machine.machine import CATALOGUE

    shares: Answer = {"causes": dict.fromkeys(CATALOGUE, CONSTANT_ID), **CONSTANT}
    if (TRAINED / "constant.json").exists():
        shares = json.loads((TRAINED / "constant.json").read_text(encoding="utf-8"))
    return {**shares, "size": {}}


def diagnose_topdress(data: Path, machine: Path) -> Answer:
    """Says what the diagnosis of this project reports, through its public functions only."""
    from topdress.drivers.files.bench_table import read_bench_table
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    import topdress

    model = load_config(str(machine), MACHINE_KIND).model
    kind = (data.parent / "kind.txt").read_text(encoding="utf-8")
    if kind == "run":
        found = topdress.diagnose_run(topdress.read_log(data), model)
    else:
        found = topdress.diagnose_tables([read_bench_table(data, kind)], model)
    causes, unknown = read_probabilities(found, model)
    nothing = [channel.structure_p for channel in found.channels]
    if found.unexplained:
        nothing = [0.0]
    unseen = float(np.prod([1.0 - p for p in (*causes.values(), unknown)]))
    adopted = data.parent / "adopted.yaml"
    topdress.save(adopted, topdress.extend(model, found))
    return {
        "causes": causes,
        "none": unseen * min(nothing, default=1.0),
        "unknown": unknown,
        "size": {
            cause.id: [cause.size.low, cause.size.value, cause.size.high]
            for cause in found.causes
            if cause.size.low is not None and cause.size.high is not None
        },
        "onset_s": {cause.id: cause.onset_s for cause in found.causes},
        "machine": str(adopted),
    }


def _find_group(effect_id: str, channels: tuple[str, ...]) -> str:
    """Returns the group of stages of an effect, for each of which there is one prior; the effects
    of a bench table alone are a group by their name."""
    from topdress.control.diagnosis.runs.model import CHANNEL_GROUPS

    own = effect_id.split(".")[0]
    return next((group for group, of in CHANNEL_GROUPS.items() if {*channels} & {*of}), own)


def read_probabilities(found: Any, model: Any) -> tuple[dict[str, float], float]:
    """Returns the probability of each effect, and of a cause on no list, that a report holds.

    Of what is named: its own, its rivals', and the unknown among them. Of what is not named: the
    prior probability that it is there and smaller than the report says it would have been seen (its
    size is Cauchy about 0). The prior is the diagnosis' own, nothing is assumed here.
    """
    from topdress.control.diagnosis.effects import EFFECT_ROWS
    from topdress.control.diagnosis.judgement.checks import FALSE_ALARM_PROB
    from topdress.control.diagnosis.judgement.prior import FAULT_PROB, UNKNOWN_PROB
    from topdress.control.diagnosis.result import UNKNOWN

    # What this data cannot show at any size is not hidden in it (README.md).
    shown = [one for one in found.not_shown if one.smallest_detectable.value is not None]
    groups = {one.id: _find_group(one.id, EFFECT_ROWS[one.id].channels) for one in shown}
    causes: dict[str, float] = {}
    for one in shown:
        usual = EFFECT_ROWS[one.id].scale_to_machine(model).usual
        least = one.smallest_detectable.value
        hidden = 2.0 / np.pi * np.arctan(least / usual) if usual > 0.0 else 0.0
        names = sum(group == groups[one.id] for group in groups.values())
        causes[one.id] = float(FAULT_PROB / names * hidden)
    # A test that finds structure without a name is wrong with the probability of a false alarm.
    unknown = UNKNOWN_PROB * FALSE_ALARM_PROB
    if found.unexplained or found.terms:
        unknown = UNKNOWN_PROB / (UNKNOWN_PROB + FALSE_ALARM_PROB)
    for cause in found.causes:
        causes[cause.id] = max(causes.get(cause.id, 0.0), cause.probability)
        for rival in cause.rivals:
            if rival.id == UNKNOWN:
                unknown = max(unknown, rival.probability)
            else:
                causes[rival.id] = max(causes.get(rival.id, 0.0), rival.probability)
    return causes, unknown


BUILT_IN: dict[str, Entry] = {
    "constant": diagnose_constant,
    "topdress": diagnose_topdress,
}
# Entries around libraries of others (peers.py, learner.py): name, module, function.
PEERS = {
    "least_squares": ("peers", "diagnose_least_squares"),
    "sysidentpy": ("peers", "diagnose_sysidentpy"),
    "pysindy": ("peers", "diagnose_pysindy"),
    "ruptures": ("peers", "diagnose_ruptures"),
    "learner": ("learner", "diagnose_learner"),
    "learner_300": ("learner", "diagnose_learner_300"),
    "learner_100": ("learner", "diagnose_learner_100"),
}


def find_entry(name: str) -> Entry:
    """Returns an entry by name: of this file, or of an installed package.

    Raises
    ------
    ValueError : there is none of that name; with those that there are.
    """
    others = {point.name: point for point in entry_points(group=GROUP)}
    if name in BUILT_IN:
        return BUILT_IN[name]
    if name in PEERS:
        module, function = PEERS[name]
        peer: Entry = getattr(import_module(module), function)
        return peer
    if name in others:
        entry: Entry = others[name].load()
        return entry
    raise ValueError(f"entry {name!r}: allowed: {', '.join([*BUILT_IN, *PEERS, *others])}")

"""Faults on a time line: `KIND:DEVICE@FROM_S[+FOR_S]`."""
from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from drivers.virtual.faults import PortFaults
from drivers.virtual.runaway import RUNAWAY_MM, RUNAWAY_RPM, Runaway

KINDS: dict[str, PortFaults] = {
    "unplug": PortFaults(unplugged=True),
    "garbage": PortFaults(garbage_share=0.5),
    "half_lines": PortFaults(half_share=0.5),
    "frozen": PortFaults(frozen=True),
    "delayed": PortFaults(delay_s=1.0),
    "duplicated": PortFaults(duplicate_share=1.0),
    "bit_flips": PortFaults(bit_flip_share=0.3),
    "wrong_baud": PortFaults(wrong_baud=True),
}
DRIVES: dict[str, Runaway] = {          # of the board's drives, not of its line
    "shaft_turns": Runaway(shaft_rpm=RUNAWAY_RPM),
    "gate_opens": Runaway(opening_mm=RUNAWAY_MM),
}
_GRAMMAR = re.compile(r"(?P<kind>[a-z_]+):(?P<device>[a-z_0-9]+)@(?P<begin>[\d.]+)(\+(?P<lasts>[\d.]+))?")


class TimedFault(NamedTuple):
    kind: str
    device: str                 # a device's name, or `heads` for all heads
    begin_s: float
    end_s: float = math.inf


def parse_fault(text: str, devices: Sequence[str]) -> TimedFault:
    """One `--fault`. Raises ValueError with one plain line."""
    match = _GRAMMAR.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"fault {text!r}: not understood: allowed KIND:DEVICE@FROM_S[+FOR_S], e.g. unplug:gnss@60+10")
    kinds = [*KINDS, *DRIVES]
    if match["kind"] not in kinds:
        raise ValueError(f"fault {text!r}: unknown kind {match['kind']}: allowed {', '.join(kinds)}")
    if match["kind"] in DRIVES and match["device"] != "board":
        raise ValueError(f"fault {text!r}: {match['kind']} is one of the board's drives: allowed {match['kind']}:board")
    known = [*devices, "heads"] if any(map(_is_head, devices)) else list(devices)
    if match["device"] not in known:
        raise ValueError(f"fault {text!r}: unknown device {match['device']}: allowed {', '.join(known)}")
    try:
        begin_s = float(match["begin"])
        lasts_s = float(match["lasts"]) if match["lasts"] else math.inf
    except ValueError:
        raise ValueError(f"fault {text!r}: FROM_S and FOR_S must be numbers of seconds") from None
    return TimedFault(match["kind"], match["device"], begin_s, begin_s + lasts_s)


def faults_at(timeline: Iterable[TimedFault], device: str, at_s: float) -> PortFaults:
    """All that is wrong with one device's line at `at_s`; of faults of one kind the worst counts."""
    found = PortFaults()
    for fault in timeline:
        names = (device, "heads" if _is_head(device) else device)
        if fault.kind in KINDS and fault.begin_s <= at_s < fault.end_s and fault.device in names:
            worse = {name: max(value, getattr(found, name)) for name, value in KINDS[fault.kind]._asdict().items()}
            found = PortFaults(**worse)
    return found


def runaway_at(timeline: Iterable[TimedFault], at_s: float) -> Runaway:
    """What the board's drives do by themselves at `at_s`."""
    found = Runaway()
    for fault in timeline:
        if fault.kind in DRIVES and fault.begin_s <= at_s < fault.end_s:
            found = found._replace(**{name: value for name, value in DRIVES[fault.kind]._asdict().items()
                                      if value is not None})
    return found


def _is_head(device: str) -> bool:
    return device.startswith("head_")

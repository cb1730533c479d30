"""What the control worker tells its consoles, up to 20 times a second: one JSON object a line.

The same frame is made from a log by replay, so that the screens know one thing only.
"""
from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from control.field.totals import Totals
from control.log_row import LogRow
from control.orders import Alarm, Severity
from control.safety import Allowances, BenchRun


@dataclass(frozen=True, slots=True)
class DeviceView:
    """One device as the Devices screen lists it."""

    name: str                 # "gnss", "heads", "board"
    port: str
    protocol: str
    connected: bool
    age_s: float | None       # since the last accepted message
    rate_hz: float
    accepted: int
    rejected: int
    last_raw: str = ""


@dataclass(frozen=True, slots=True)
class Frame:
    seq: int
    at_s: float                                   # the worker's monotonic clock
    row: LogRow
    alarms: tuple[Alarm, ...] = ()
    dropped_heads: tuple[int, ...] = ()           # 1-based
    metres_left_m: float | None = None            # until the hopper is empty at the present rate
    area_ha: float = 0.0                          # worked so far
    applied_kg: float = 0.0
    gnss_age_s: float | None = None
    gnss_hz: float | None = None
    usable_speed_mps: float | None = None         # highest speed whose lead the heads still cover
    look_ahead: bool = True
    flow_trim_on: bool = True
    job: str = ""
    machine: str = ""
    crop: str = ""
    log_path: str = ""
    simulated: bool = False
    place_m: tuple[float, float] | None = None    # outlet, east and north of the field's origin
    devices: tuple[DeviceView, ...] = ()
    notes: tuple[str, ...] = field(default=())    # e.g. "lag_out_of_range"
    why_no_flow: tuple[str, ...] = ()             # ids of `control.safety.INTERLOCKS`; empty: flow is allowed
    why_state: str = ""                           # an order, an alarm id, or one of `control.safety.STATE_REASONS`
    allow: Allowances = field(default_factory=Allowances)     # what the operator told safety to put up with
    totals: Totals | None = None                  # of the job so far, anew once a second
    head_ndvi: tuple[float | None, ...] = ()      # every head, left to right; None: silent
    bench: BenchRun | None = None                 # while calibrating: set-points as sent, seconds gone and left


_NAMED: dict[str, Any] = {"row": LogRow, "allow": Allowances, "totals": Totals, "bench": BenchRun}


def to_json(frame: Frame) -> bytes:
    tuples = {name: part._asdict() for name in _NAMED if (part := getattr(frame, name)) is not None}
    return json.dumps(asdict(frame) | tuples | {"alarms": [a._asdict() for a in frame.alarms]},
                      separators=(",", ":"), allow_nan=False).encode() + b"\n"


def from_json(message: dict[str, Any]) -> Frame:
    """Unknown keys are ignored, so that an older console can look at a newer worker."""
    known = {k: v for k, v in message.items() if k in Frame.__dataclass_fields__}
    for name, kind in _NAMED.items():
        if known.get(name) is not None:
            known[name] = kind(**{k: v for k, v in known[name].items() if k in kind._fields})
    known["alarms"] = tuple(
        Alarm(**(a | {"severity": Severity(a["severity"]), "details": tuple((k, v) for k, v in a["details"])}))
        for a in message.get("alarms", ()))
    known["devices"] = tuple(DeviceView(**d) for d in message.get("devices", ()))
    for name in ("dropped_heads", "notes", "why_no_flow", "head_ndvi"):
        known[name] = tuple(message.get(name, ()))
    if known.get("place_m") is not None:
        known["place_m"] = tuple(known["place_m"])
    return Frame(**known)

"""What the control worker tells its consoles, ten times a second while the machine moves: one
JSON object a line.

The same frame is made from a log by replay, so that the screens know one thing only.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

from topdress.console.attached import Attached, Ordered
from topdress.control.agronomy.strips import Strips
from topdress.control.field.totals import Totals
from topdress.control.log_row import LogRow
from topdress.control.orders import Alarm, SectionState
from topdress.control.readings import NO_EFFORT_FINDING, EffortFinding
from topdress.control.safety import Allowances, BenchRun
from topdress.drivers.device_status import DeviceStatus

LEAST_AREA_HA = 1e-4  # 1 m2: less ground has no mean rate


class DeviceDo(StrEnum):
    """Lists the orders for a single device (`Link.send_device_order`)."""

    CONNECT = "connect"
    # refused while the state is working or calibrating
    DISCONNECT = "disconnect"
    TEST = "test"  # listens what speaks there; nothing is sent
    CAPTURE = "capture"  # what comes and goes into a file next to the log
    END_CAPTURE = "end_capture"


class DeviceTest(NamedTuple):
    """Holds the findings of listening to a device so far."""

    running: bool
    protocol: str = ""  # empty: nothing known speaks there
    # of a serial line, where it was found at another rate than configured
    baud: int | None = None
    accepted: int = 0
    rejected: int = 0
    # the last line heard, or why the port cannot be used
    said: str = ""


class LagTestView(NamedTuple):
    """Holds the lag test under way (`Link.send_lag_test_order`): it goes on while the state is
    calibrating."""

    phase: str  # settling, arming, running, done
    shaft_rpm: float  # of the run under way
    replicate: int
    progress: float  # 0 to 1
    # shaft speed r/min, response s, drop s: as far as measured
    runs: tuple[tuple[float, float, float], ...]
    left_out: int  # runs given up
    said: str = ""  # the newest failure, in English
    table_path: str = ""  # the lag bench table, complete as far as `runs`


class Tally(NamedTuple):
    """Holds counts of a job, its parts before a power cut included."""

    held_s: float = 0.0
    moves: int = 0  # of the opening's set-point, while working
    refills: tuple[tuple[str, float], ...] = ()  # worker's UTC, kg
    # the part of the job before this one; empty: none
    log_before: str = ""
    began_utc: str = ""
    finished: bool = False  # the operator said so
    # why the job could not go on after a power cut; one line
    trouble: str = ""
    # thought to have been released after the last row, and counted
    after_cut_kg: float | None = None
    after_cut_scale_kg: float | None = None  # the same by the scale, once it is known


@dataclass(frozen=True, slots=True)
class DeviceView(DeviceStatus):
    """Holds one device as the Devices screen lists it."""

    plugged: bool = True  # False: disconnected by order
    # the file that is being written; empty: no capture
    capture_path: str = ""
    test: DeviceTest | None = None


@dataclass(frozen=True, slots=True)
class Frame:
    """Holds all that the worker tells its consoles at one moment."""

    seq: int
    at_s: float  # the worker's monotonic clock
    row: LogRow
    alarms: tuple[Alarm, ...] = ()
    dropped_heads: tuple[int, ...] = ()  # 1-based
    metres_left_m: float | None = None  # until the hopper is empty at the present rate
    area_ha: float = 0.0  # worked so far
    applied_kg: float = 0.0
    gnss_age_s: float | None = None
    gnss_hz: float | None = None
    usable_speed_mps: float | None = None  # highest speed whose lead the heads still cover
    look_ahead: bool = True
    flow_trim_on: bool = True
    job: str = ""
    machine: str = ""
    crop: str = ""
    log_path: str = ""
    simulated: bool = False
    # outlet, east and north of the field's origin
    place_m: tuple[float, float] | None = None
    devices: tuple[DeviceView, ...] = ()
    notes: tuple[str, ...] = field(default=())  # e.g. "lag_out_of_range"
    # ids of `control.safety.INTERLOCKS`; empty: flow is allowed
    why_no_flow: tuple[str, ...] = ()
    # an order, an alarm id, or one of `control.safety.STATE_REASONS`
    why_state: str = ""
    allow: Allowances = field(default_factory=Allowances)  # what the operator allows
    totals: Totals | None = None  # of the job so far, anew once a second
    head_ndvi: tuple[float | None, ...] = ()  # every head, left to right; None: silent
    lag_test: LagTestView | None = None
    tally: Tally | None = None
    # while calibrating: set-points as sent, seconds gone and left
    bench: BenchRun | None = None
    no_double: bool = True  # ground that has its material gets no more
    threshold_m: float | None = None  # of point mode, as learned, at the present speed
    # left to right; none: the machine has no valves
    sections: tuple[SectionState, ...] = ()
    # N-rich and farmer check, as they count now
    strips: Strips = field(default_factory=Strips)
    sources: tuple[str, ...] = ()  # of the target, that the job has; empty: none
    # what each of `sources` gives here, kg/ha, without the nudge; None: single doses; empty: the
    # worker does not tell
    source_rates: tuple[float | None, ...] = ()
    # of the target, as ordered; what stands in for it is in the row
    ordered_source: str = ""
    manual_rate_kg_ha: float | None = None  # as ordered, also while another source holds
    consoles: int = 0  # that keep the machine working now; 0: not given
    # consoles and tablets, in the order in which they came
    attached: tuple[Attached, ...] = ()
    # the latest orders that were followed, the newest last
    ordered: tuple[Ordered, ...] = ()
    # of the metering drive, and where its alarms begin
    effort: EffortFinding = NO_EFFORT_FINDING

    @property
    def mean_rate_kg_ha(self) -> float | None:
        """Mean rate on the worked area, kg/ha; mass released while commanded to stop lies on none.
        None below `LEAST_AREA_HA`."""
        stopped_kg = 0.0 if self.totals is None else self.totals.stopped_kg
        return (
            (self.applied_kg - stopped_kg) / self.area_ha if self.area_ha > LEAST_AREA_HA else None
        )


_NAMED_TUPLES = ("row", "allow", "totals", "bench", "lag_test", "tally", "strips", "effort")


def format_frame_json(frame: Frame) -> bytes:
    """The frame as one line of JSON. Raises ValueError for a number that is not finite."""
    tuples: dict[str, Any] = {
        name: part._asdict() for name in _NAMED_TUPLES if (part := getattr(frame, name)) is not None
    }
    for name in ("alarms", "attached", "ordered"):
        tuples[name] = [one._asdict() for one in getattr(frame, name)]
    tuples["devices"] = [
        _list_field_values(one) | {"test": one.test and one.test._asdict()} for one in frame.devices
    ]
    return (
        json.dumps(
            _list_field_values(frame) | tuples, separators=(",", ":"), allow_nan=False
        ).encode()
        + b"\n"
    )


def _list_field_values(one: Frame | DeviceView) -> dict[str, Any]:
    return {name: getattr(one, name) for name in one.__dataclass_fields__}


def parse_frame(message: dict[str, Any]) -> Frame:
    """The frame of a worker's message. Unknown keys are ignored, so that an older console can show
    a newer worker. Raises ValueError, one line."""
    # pydantic: the worker, which writes frames, starts without it
    from topdress.drivers.files.plain import build_from_plain

    return build_from_plain(Frame, message)

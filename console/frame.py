"""Which data does the control worker send to its consoles? Ten times a second while the machine
moves it sends a frame, one JSON object a line.

Replay makes the same frame from a log, so that the screens need only one format.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

from topdress.console.attached_consoles import AttachedConsole, ExecutedOrder
from topdress.control.agronomy.reference_strips import ReferenceStrips
from topdress.control.field.job_totals import Totals
from topdress.control.log_row import LogRow
from topdress.control.orders import Alarm, SectionState
from topdress.control.readings import NO_EFFORT_FINDING, EffortFinding
from topdress.control.safety import Allowances, BenchRun
from topdress.drivers.device_status import DeviceStatus

# Smallest area with a mean rate: 1 m2.
MIN_AREA_HA = 1e-4


class DeviceDo(StrEnum):
    """Lists the orders for a single device (`Link.send_device_order`)."""

    CONNECT = "connect"
    # This order is refused while the state is working or calibrating.
    DISCONNECT = "disconnect"
    # A test only listens to the line; nothing is sent.
    TEST = "test"
    # A capture writes received and sent bytes to a file next to the log.
    CAPTURE = "capture"
    END_CAPTURE = "end_capture"


class DeviceTest(NamedTuple):
    """Holds the findings of listening to a device so far."""

    running: bool
    # Empty if no known device speaks on the line.
    protocol: str = ""
    # Baud rate of a serial line, where it differs from the configured rate.
    baud: int | None = None
    accepted: int = 0
    rejected: int = 0
    # The last received line, or the reason why the port cannot be used.
    said: str = ""


class LagTestView(NamedTuple):
    """Holds the present lag test (`Link.send_lag_test_order`), which continues while the state is
    calibrating."""

    # One of settling, arming, running, done.
    phase: str
    # Shaft speed of the present run, r/min.
    shaft_rpm: float
    replicate: int
    # Completed share, 0 to 1.
    progress: float
    # Shaft speed (r/min), response (s) and drop time (s) of the measured runs.
    runs: tuple[tuple[float, float, float], ...]
    # Number of abandoned runs.
    left_out: int
    # The newest failure, in English.
    said: str = ""
    # The lag bench table, which contains all of `runs`.
    table_path: str = ""


class JobCounts(NamedTuple):
    """Holds counts of a job, including its parts before a power cut."""

    held_s: float = 0.0
    # Number of changes of the opening's set-point while working.
    moves: int = 0
    # The worker's UTC and the mass of each refill, kg.
    refills: tuple[tuple[str, float], ...] = ()
    # Log of the previous part of the job; empty for the first part.
    log_before: str = ""
    began_utc: str = ""
    # Whether the operator has finished the job.
    finished: bool = False
    # Reason why the job could not continue after a power cut; one line.
    trouble: str = ""
    # Mass that was probably released after the last row, which the totals include.
    after_cut_kg: float | None = None
    # The same mass by the scale, once it is known.
    after_cut_scale_kg: float | None = None


@dataclass(frozen=True, slots=True)
class DeviceView(DeviceStatus):
    """Holds one device as the Devices screen lists it."""

    # False means disconnected by an order.
    plugged: bool = True
    # The file that is being written; empty without a capture.
    capture_path: str = ""
    test: DeviceTest | None = None


@dataclass(frozen=True, slots=True)
class Frame:
    """Holds all data that the worker sends to its consoles at one moment."""

    seq: int
    # Time on the worker's monotonic clock, s.
    at_s: float
    row: LogRow
    alarms: tuple[Alarm, ...] = ()
    # Numbers of the heads, counted from 1.
    dropped_heads: tuple[int, ...] = ()
    # Distance until the hopper is empty at the present rate.
    metres_left_m: float | None = None
    # Area worked so far.
    area_ha: float = 0.0
    applied_kg: float = 0.0
    gnss_age_s: float | None = None
    gnss_hz: float | None = None
    # Highest speed whose required lead the heads still provide.
    usable_speed_mps: float | None = None
    look_ahead: bool = True
    flow_trim_on: bool = True
    job: str = ""
    machine: str = ""
    crop: str = ""
    log_path: str = ""
    simulated: bool = False
    # Position of the outlet, m east and north of the field's origin.
    place_m: tuple[float, float] | None = None
    devices: tuple[DeviceView, ...] = ()
    # Ids of notes, such as "lag_out_of_range".
    notes: tuple[str, ...] = field(default=())
    # Ids of `control.safety.INTERLOCKS`; empty if flow is allowed.
    why_no_flow: tuple[str, ...] = ()
    # An order, an alarm id, or one of `control.safety.STATE_REASONS`.
    why_state: str = ""
    # Permissions that the operator has given.
    allow: Allowances = field(default_factory=Allowances)
    # Totals of the job so far, updated once a second.
    totals: Totals | None = None
    # NDVI of every head from left to right; None for a silent head.
    head_ndvi: tuple[float | None, ...] = ()
    lag_test: LagTestView | None = None
    tally: JobCounts | None = None
    # Calibration run: set-points as sent, elapsed and remaining seconds; None in other states.
    bench: BenchRun | None = None
    # Whether ground that already has its material gets no more.
    no_double: bool = True
    # Trigger distance of point mode, as learned, at the present speed.
    threshold_m: float | None = None
    # States of the sections from left to right; empty for a machine without valves.
    sections: tuple[SectionState, ...] = ()
    # Present values of the N-rich strip and the farmer check.
    strips: ReferenceStrips = field(default_factory=ReferenceStrips)
    # Sources of the target that the job has; empty without a job.
    sources: tuple[str, ...] = ()
    # Rate of each of `sources` at this place without the nudge, kg/ha; None for single doses; empty
    # if the worker does not send them.
    source_rates: tuple[float | None, ...] = ()
    # The ordered source of the target; the row names the source in use.
    ordered_source: str = ""
    # The ordered manual rate, even while another source is in use.
    manual_rate_kg_ha: float | None = None
    # Number of consoles that keep the machine working; 0 if not sent.
    consoles: int = 0
    # Consoles and tablets, in the order in which they attached.
    attached: tuple[AttachedConsole, ...] = ()
    # The latest executed orders, the newest last.
    ordered: tuple[ExecutedOrder, ...] = ()
    # Effort of the metering drive, and the level at which its alarms begin.
    effort: EffortFinding = NO_EFFORT_FINDING

    @property
    def mean_rate_kg_ha(self) -> float | None:
        """Mean rate on the worked area, kg/ha; None below `MIN_AREA_HA`. Mass that was released
        while commanded to stop is excluded."""
        stopped_kg = 0.0 if self.totals is None else self.totals.stopped_kg
        return (self.applied_kg - stopped_kg) / self.area_ha if self.area_ha > MIN_AREA_HA else None


_NAMED_TUPLES = ("row", "allow", "totals", "bench", "lag_test", "tally", "strips", "effort")


def format_frame_json(frame: Frame) -> bytes:
    """Returns the frame as one line of JSON. Raises ValueError for a number that is not finite."""
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
    """Returns the frame of a worker's message. Unknown keys are ignored, so that an older console
    can show a newer worker. Raises ValueError, one line."""
    # This import is local, because the worker, which writes frames, starts without pydantic.
    from topdress.drivers.files.plain_data import build_from_plain

    return build_from_plain(Frame, message)

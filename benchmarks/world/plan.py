"""What happens on one day? A seed draws the farm, the weather and every event; an event list can
be written, cut down and run again."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from topdress.control.orders import Do
from topdress.drivers.virtual.faults import LINE_FAULTS

# Time at which every fault has ended, and time that the operator then has, s.
FAULTS_END_S = 90.0
RECOVERY_S = 40.0
DEVICES = ("gnss", "board", *(f"head_{n}" for n in range(1, 7)))
# Interval of the cab's console between two keys, s.
KEY_INTERVAL_S = 0.3


class Event(NamedTuple):
    """Holds one event: its time, its kind, its details, and its duration."""

    at_s: float
    kind: str
    what: Any = None
    lasts_s: float = 0.0

    def __str__(self) -> str:
        lasts = f" for {self.lasts_s:.1f} s" if self.lasts_s else ""
        return f"{self.at_s:7.2f} {self.kind} {json.dumps(self.what)}{lasts}"


class Day(NamedTuple):
    """Holds everything that decides a run."""

    seed: int
    farm: str
    hz: float
    # Values of the job's section `simulated`.
    simulated: dict[str, Any]
    events: tuple[Event, ...]
    # Whether nothing is wrong on this day.
    calm: bool = False
    # Time at which every fault has ended, s.
    faults_end_s: float = FAULTS_END_S

    @property
    def end_s(self) -> float:
        """Time at which the run ends, s."""
        return self.faults_end_s + RECOVERY_S

    def to_json(self) -> str:
        """Returns the day as text, an event to a line."""
        data = self._asdict()
        events = ",\n  ".join(json.dumps(event) for event in data.pop("events"))
        return f'{json.dumps(data)[:-1]},\n "events": [\n  {events}]}}\n'

    @classmethod
    def from_json(cls, text: str) -> Day:
        """Returns the day of a text."""
        data = json.loads(text)
        return cls(**data | {"events": tuple(Event(*event) for event in data["events"])})


# Machine, job and cab of each farm; `make_files` in `farm.py` writes them.
FARMS = ("canopy", "map", "external", "sections", "headland", "manual")

LIES: dict[str, tuple[Any, ...]] = {
    # Factors of what a sensor reads.
    "wheel_times": (0.0, 0.3, 0.5, 2.0, 4.0),
    "gnss_speed_times": (0.0, 0.5, 2.0),
    "shaft_reads_times": (0.0, 0.5, 1.5),
    "scale_times": (0.5, 1.3),
    # Offsets: m/s across, mm, kg/s.
    "place_walks_mps": (0.5, 3.0, 30.0),
    "place_jumps_m": (5.0, 300.0),
    "gate_reads_more_mm": (-3.0, 5.0),
    "scale_leaks_kg_s": (0.3, -0.3),
    # Values at which a sensor stands.
    "heads_read": (0.0, 0.96, 0.3),
    "scale_reads_kg": (0.0, 150.0),
    # Drives: r/min or mm whatever the command, or a factor.
    "shaft_turns_rpm": (30.0, 70.0),
    "shaft_stands": (True,),
    "shaft_turns_times": (0.6, 1.4),
    "gate_stands_mm": (0.0, 4.0, 60.0),
    "driver_fault": (True,),
    "effort_times": (0.3, 3.0),
    "switch_up": (True,),
    "valve_stays_open": (True,),
}
# Values of the other display, kg/ha; None: silence.
ASKED_RATES = (0.0, 80.0, 180.0, 250.0, 1900.0, None)
# Keys of an operator who changes his mind.
KEYS = ("ready", "start", "start", "hold", "hold", "stop", "stop", "acknowledge")
DISK_KINDS = ("fails", "tears", "full", "hangs", "readonly", "cut_by_others", "deleted")


def draw_number(r: random.Random, low: float, high: float) -> Any:
    """Returns a value of an order: mostly allowed, sometimes absurd."""
    return r.choice(
        [*(r.uniform(low, high) for _ in range(8)), low, high, -high, 1e9, "x", None, True]
    )


def draw_order(r: random.Random) -> tuple[str, Any]:
    """Returns an order with its value, right or wrong."""
    yes = r.choice([True, False, True, False, "x"])
    made: list[tuple[Do, Callable[[], Any]]] = [
        (Do.READY, lambda: None),
        (Do.START, lambda: None),
        (Do.START, lambda: True),
        (Do.HOLD, lambda: None),
        (Do.STOP, lambda: None),
        (Do.ACKNOWLEDGE, lambda: r.choice(["", "x", "console_silent", "shaft_silent"])),
        (Do.STRATEGY, lambda: r.choice(["opening_first", "speed_first", "balanced", "x"])),
        (
            Do.SOURCE,
            lambda: r.choice(["canopy", "manual", "fallback", "map", "none", "external", "point"]),
        ),
        (Do.NUDGE, lambda: draw_number(r, -30, 30)),
        (Do.MANUAL_RATE, lambda: draw_number(r, 0, 500)),
        (Do.REFILL, lambda: draw_number(r, 1, 200)),
        (Do.REFILL_BACK, lambda: draw_number(r, 1, 200)),
        (Do.FLOW_TRIM, lambda: yes),
        (Do.LOOK_AHEAD, lambda: yes),
        (Do.NO_DOUBLE, lambda: yes),
        (Do.ALLOW_OUTSIDE, lambda: yes),
        (Do.ALLOW_REVERSE, lambda: yes),
        (Do.ALLOW_NO_WHEEL, lambda: yes),
        (Do.ALLOW_MAP_ELSEWHERE, lambda: yes),
        (Do.GO_ON_UNLOGGED, lambda: yes),
        (Do.CALIBRATE, lambda: draw_number(r, 1, 60)),
        (Do.CALIBRATE_SHAFT, lambda: draw_number(r, 0, 120)),
        (Do.CALIBRATE_OPENING, lambda: draw_number(r, 0, 60)),
        (Do.RELEASE, lambda: None),
        (Do.SECTION, lambda: r.choice(["1 off", "1 auto", "all auto", "9 off", "x"])),
        (Do.STRIP, lambda: r.choice(["none", "x", None])),
        (Do.MARK, lambda: r.choice(["hello", "a;b", "\x1b[31m", "x" * 500, "job finishe"])),
        (Do.DOSE_ERROR, lambda: draw_number(r, -1, 1)),
    ]
    do, value = r.choice(made)
    return do.value, value()


def draw_day(seed: int, kinds: Iterable[str] = (), faults_end_s: float | None = None) -> Day:
    """Returns the day of a seed.

    Parameters
    ----------
    seed : every number of the day comes from it.
    kinds : names of `DRAWS` that this day must have, as the steering by coverage asks for.
    faults_end_s : end of all faults; None: by the seed. A shorter day has the same events sooner
    after each other.
    """
    r = random.Random(seed)
    calm = r.random() < 0.1 and not kinds
    farm = r.choice(FARMS)
    simulated: dict[str, Any] = {
        "speed_kmh": round(r.uniform(3.0, 7.0), 2),
        "slope_deg": r.choice([0.0, 0.0, -6.0, 6.0]),
        "roughness_deg": r.choice([0.2, 0.5, 1.0]),
        "hopper_kg": r.choice([300.0, 200.0] if calm else [300.0, 200.0, 33.0, 22.0]),
        "refill_stop_s": 15.0,
        "refill_at_kg": r.choice([20.0, 0.0]),
        "pass_length_m": r.choice([60.0, 120.0]),
        "gnss_hz": r.choice([10.0, 10.0, 5.0, 1.0]),
        "wind_kg": r.choice([0.0, 0.0, 2.0]),
    }
    events = [Event(2.0, "key", "ready"), Event(2.5, "key", "start")]
    if not calm:
        events = draw_work(r)
        for name in [name for name in DRAWS if r.random() < DRAWS[name][0]]:
            events += [DRAWS[name][1](r) for _ in range(r.randrange(1, 4))]
        for kind in kinds:
            farm, simulated, more = draw_kind(r, kind, farm, simulated)
            events += more
    drawn_s = FAULTS_END_S if calm else r.choice([30.0, 30.0, 50.0, FAULTS_END_S])
    faults_end_s = faults_end_s or drawn_s
    pace = faults_end_s / FAULTS_END_S
    events = [event._replace(at_s=round(pace * event.at_s, 3)) for event in events]
    hz = r.choice([5.0, 10.0, 10.0, 20.0])
    ordered = sort_events(events, faults_end_s)
    return Day(seed, farm, hz, simulated, ordered, calm, faults_end_s)


def draw_kind(
    r: random.Random, kind: str, farm: str, simulated: dict[str, Any]
) -> tuple[str, dict[str, Any], list[Event]]:
    """Returns farm, simulated values and further events towards a kind of event.

    `NAME` is a draw of `DRAWS`; `NAME:DETAIL` has a given detail: a lie, a device, an order, a kind
    of disk's fault, a farm, or a value of the job. `long` means that nothing else disturbs work.
    """
    name, _, detail = kind.partition(":")
    if name == "farm":
        return detail, simulated, []
    if name in ("hopper", "gnss_hz"):
        key = "hopper_kg" if name == "hopper" else name
        return farm, simulated | {key: float(detail), "refill_at_kg": 0.0}, []
    if name == "long":
        return farm, simulated | {"pass_length_m": 120.0}, [Event(12.0, "key", "start")]
    events = [DRAWS[name][1](r) for _ in range(2)]
    if name == "lie" and detail:
        events = [Event(15.0, name, [detail, r.choice(LIES[detail])], 70.0)]
    elif name == "line" and detail:
        events = [Event(20.0, name, [detail, "unplug"], 12.0)]
    elif detail:
        events = [event._replace(what=_set_detail(event.what, detail, r)) for event in events]
    return farm, simulated, events


def _set_detail(what: Any, detail: str, r: random.Random) -> Any:
    """Returns the details of an event with the wanted detail."""
    if isinstance(what, list) and len(what) == 3:
        return [0, *next(o for o in iter(lambda: draw_order(r), None) if o[0] == detail)]
    return [detail, *what[1:]] if isinstance(what, list) else detail


def sort_events(events: Iterable[Event], end_s: float = FAULTS_END_S) -> tuple[Event, ...]:
    """Returns the events in their order; each fault ends before `end_s`."""
    return tuple(
        event._replace(lasts_s=round(min(event.lasts_s, end_s - event.at_s), 3))
        for event in sorted(events, key=lambda event: event.at_s)
        if event.at_s < end_s
    )


def draw_work(r: random.Random) -> list[Event]:
    """Returns the keys of an operator who wants to work."""
    events, at_s = [], 2.0
    while at_s < FAULTS_END_S:
        events += [
            Event(round(at_s + KEY_INTERVAL_S * k, 3), "key", key)
            for k, key in enumerate(("acknowledge", "ready", "start"))
        ]
        at_s += r.uniform(5.0, 15.0)
    return events


def _when(r: random.Random, first_s: float = 1.0) -> float:
    return round(r.uniform(first_s, FAULTS_END_S - 1.0), 3)


def _draw_calibration(r: random.Random) -> Event:
    return Event(
        _when(r),
        "calibrate",
        [r.choice([5.0, 20.0, 60.0]), r.choice([None, 30.0, 70.0, 500.0]), r.choice([None, 12.0])],
        r.choice([0.3, 2.0, 8.0, 25.0]),
    )


def _draw_lie(r: random.Random) -> Event:
    name = r.choice(list(LIES))
    return Event(_when(r), "lie", [name, r.choice(LIES[name])], r.choice([2.0, 10.0, 40.0, 60.0]))


def _draw_cut(r: random.Random) -> Event:
    # The seconds without power, the disk's call at which it ends (0 for at once), and the seconds
    # for which the driver then reverses.
    away_s, calls = r.choice([0.2, 3.0, 9.0]), r.choice([0, 0, 1, 2, 3, 5])
    return Event(_when(r, 10.0), "cut", [away_s, calls, r.choice([0.0, 0.0, 6.0, 9.0])])


def _draw_way_back(r: random.Random) -> Event:
    return Event(_when(r, 20.0), "drive", -1.5, r.choice([5.0, 10.0]))


def _draw_disk(r: random.Random) -> Event:
    return Event(
        _when(r),
        "disk",
        [r.choice(DISK_KINDS), r.randrange(1, 8)],
        r.choice([0.5, 3.0, 10.0, 30.0]),
    )


def _draw_stranger(r: random.Random) -> Event:
    return Event(
        _when(r), "stranger", r.choice(["garbage", "wrong_key", "long", "half", "flood", "look"])
    )


def _draw_device_order(r: random.Random) -> Event:
    acts = ["connect", "disconnect", "test", "capture", "end_capture", "x"]
    return Event(_when(r), "device", [r.randrange(4), r.choice([*DEVICES, "none"]), r.choice(acts)])


# Probability on a day, and the draw of one event.
DRAWS: dict[str, tuple[float, Callable[[random.Random], Event]]] = {
    "order": (0.8, lambda r: Event(_when(r), "order", [r.choice([0, 0, 1, 2]), *draw_order(r)])),
    "orders": (0.5, lambda r: Event(_when(r), "order", [0, *draw_order(r)])),
    "keys": (0.6, lambda r: Event(_when(r), "keys", [r.choice(KEYS) for _ in range(8)])),
    "silent": (0.4, lambda r: Event(_when(r), "silent", 0, r.choice([0.3, 1.0, 3.0, 8.0, 65.0]))),
    "attach": (0.5, lambda r: Event(_when(r), "attach", r.randrange(1, 6), r.uniform(2.0, 60.0))),
    "line": (
        0.6,
        lambda r: Event(
            _when(r),
            "line",
            [r.choice(DEVICES), r.choice(list(LINE_FAULTS))],
            r.choice([0.2, 1.0, 3.0, 10.0, 40.0]),
        ),
    ),
    "lie": (0.5, _draw_lie),
    "late": (0.4, lambda r: Event(_when(r), "late", None, r.choice([0.05, 0.2, 0.9, 1.1, 3.0, 6]))),
    "suspend": (0.15, lambda r: Event(_when(r), "suspend", None, r.choice([0.5, 5.0, 60.0]))),
    "clock": (0.2, lambda r: Event(_when(r), "clock", r.choice([-3600.0, -1.0, 1.0, 86400.0]))),
    "reset": (0.25, lambda r: Event(_when(r), "reset")),
    "disk": (0.4, _draw_disk),
    "cut": (0.35, _draw_cut),
    # The program is ended and started with another job, or with the same.
    "restart": (0.2, lambda r: Event(_when(r, 10.0), "restart", r.choice([*FARMS, ""]))),
    "drive": (
        0.5,
        lambda r: Event(
            _when(r), "drive", r.choice([0.0, 0.0, 1.2, 12.0, -2.0]), r.choice([2.0, 12.0, 25.0])
        ),
    ),
    "burst": (0.15, lambda r: Event(_when(r), "burst", r.choice([20, 100, 400]))),
    "drive_back": (0.3, _draw_way_back),
    "calibrate": (0.3, _draw_calibration),
    "stranger": (0.3, _draw_stranger),
    "device": (0.3, _draw_device_order),
    "lag_test": (0.1, lambda r: Event(_when(r), "ask", r.choice(["lag_test", "end_lag_test"]))),
    "asked_rate": (0.2, lambda r: Event(_when(r), "asked_rate", r.choice(ASKED_RATES), 12.0)),
    "held_start": (0.2, lambda r: Event(_when(r), "held_start", None, r.choice([1.0, 5.0]))),
    "raises": (0.1, lambda r: Event(_when(r), "raises", r.choice(["loop", "device"]))),
    "replay": (0.1, lambda r: Event(_when(r), "replay", None, r.choice([1.0, 5.0]))),
    "pour": (0.2, lambda r: Event(_when(r), "pour", r.choice([20.0, 60.0]))),
}


def is_finite_value(value: Any) -> bool:
    """Returns whether a value can be sent as JSON."""
    return not isinstance(value, float) or math.isfinite(value)

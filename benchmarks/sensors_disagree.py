"""Two sensors that disagree, and drives that do not follow: what lies on the ground, and when
it is said.

    python -m benchmarks sensors_disagree [--only TEXT] [--hours 10]

Worker's loop, cab and drivers against the virtual machine's bytes, on an injected clock, 200
kg/ha by hand at 1.25 m/s. From `ONSET_S` on one sensor of a pair lies, or a drive does not
follow, with an RTK fix and with a plain one. Printed: what the plant gave the ground in the 30
s from then on against a twin without the fault, the alarms, each with its seconds, and the
state at the end. Then healthy hours of the same machine on slopes, in slip and bursts of slip,
through turns, stops and refills: the alarms that nobody should have heard.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import cache
from math import exp, inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from rig import DT_S, Rig
from topdress.control.geodesy import TangentPlane
from topdress.control.orders import Do, Order, State, TargetSource
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.virtual.faults import DriveRunaway
from verdict import exit_code

ONSET_S, LASTS_S = 40.0, 30.0
RATE_KG_HA = 200.0
PULSE_M = 2.50 / 16.0
SIM: dict[str, Any] = {"pass_length_m": 400.0, "begin_m": 20.0}
# as position_walks has a plain receiver
PLAIN_WHITE_M, PLAIN_SLOW_M, PLAIN_SLOW_S = 0.3, 1.8, 120.0
RUNAWAY_RPM = 95.0


class Sensors:
    """Between the plant and its bytes: from `begin_s` on the wheel and GNSS's speed are what
    they are said to be."""

    def __init__(
        self,
        plain: bool,
        wheel: Callable[[float], float] | None = None,
        gnss: Callable[[float], float] | None = None,
        begin_s: float = ONSET_S,
        seed: int = 7,
    ) -> None:
        self._plain, self._wheel, self._gnss, self._begin_s = plain, wheel, gnss, begin_s
        self._rng = np.random.default_rng(seed)
        self._slow = self._rng.standard_normal(2) * PLAIN_SLOW_M
        self._plane: TangentPlane | None = None
        self._way_m, self._pulses, self._pulse_s, self._next_s = 0.0, 0, None, 0.0

    def __call__(self, sensed: SensorReadings) -> SensorReadings:
        lies = sensed.time_s >= self._begin_s
        mps = (
            self._wheel(sensed.wheel_speed_mps) if lies and self._wheel else sensed.wheel_speed_mps
        )
        self._way_m += mps * DT_S
        if int(self._way_m / PULSE_M) > self._pulses:
            self._pulses = int(self._way_m / PULSE_M)
            self._pulse_s = sensed.time_s - (self._way_m - self._pulses * PULSE_M) / mps
        fix = sensed.gnss
        if fix is not None and lies and self._gnss:
            fix = fix._replace(speed_mps=self._gnss(fix.speed_mps or 0.0))
        if self._plain:
            fix = self._as_plain(sensed.time_s, fix)
        return sensed._replace(
            wheel_speed_mps=mps, wheel_pulses=self._pulses, wheel_pulse_s=self._pulse_s, gnss=fix
        )

    def _as_plain(self, now_s: float, fix: Any) -> Any:
        """A receiver without corrections, once a second."""
        keep = exp(-DT_S / PLAIN_SLOW_S)
        self._slow = keep * self._slow + sqrt(
            1.0 - keep * keep
        ) * PLAIN_SLOW_M * self._rng.standard_normal(2)
        if fix is None or now_s < self._next_s - 1e-9:
            return None
        self._next_s = now_s + 1.0
        self._plane = self._plane or TangentPlane(fix.lat_deg, fix.lon_deg)
        east, north = self._plane.project_to_m(fix.lat_deg, fix.lon_deg)
        off = self._slow + PLAIN_WHITE_M * self._rng.standard_normal(2)
        lat, lon = self._plane.convert_to_deg(east + float(off[0]), north + float(off[1]))
        return fix._replace(lat_deg=lat, lon_deg=lon, fix_quality=1)


class Case(NamedTuple):
    """`wheel`, `gnss`: what becomes of a speed, m/s; `drives`: what the machine's drives do
    from the onset on."""

    name: str
    wheel: Callable[[float], float] | None = None
    gnss: Callable[[float], float] | None = None
    drives: Callable[[Rig], DriveRunaway] | None = None
    effect: str = ""
    speeds: tuple[tuple[float, float], ...] = ()  # at s, m/s
    rate_kg_ha: float = RATE_KG_HA
    # that names it, after at most so many seconds, with RTK and with a plain fix
    alarm: str = ""
    by_s: tuple[float, float] = (inf, inf)


def _times(factor: float) -> Callable[[float], float]:
    return lambda mps: factor * mps


def _gate_off(it: Rig) -> DriveRunaway:
    return DriveRunaway(opening_mm=it.ticks[-1].command.opening_mm + 3.0)


CASES = (
    *(
        Case(
            f"wheel x {factor:g}", wheel=_times(factor), alarm="wheel_too_little", by_s=(4.5, 20.0)
        )
        for factor in (0.3, 0.5)
    ),
    *(Case(f"wheel x {factor:g}", wheel=_times(factor)) for factor in (0.8, 1.2)),
    *(
        Case(f"wheel x {factor:g}", wheel=_times(factor), alarm="wheel_too_much", by_s=(2.5, 10.0))
        for factor in (2.0, 4.0)
    ),
    Case(
        "wheel constant 1.25, machine 0.6 m/s",
        wheel=lambda mps: 1.25,
        speeds=((0.0, 1.25), (ONSET_S, 0.6)),
        alarm="wheel_too_much",
        by_s=(6.0, 20.0),
    ),
    Case("wheel stuck at 5 m/s", wheel=lambda mps: 5.0, alarm="wheel_too_much", by_s=(2.5, 10.0)),
    Case("GNSS speed x 0.5", gnss=_times(0.5), alarm="gnss_speed_wrong", by_s=(5.0, 20.0)),
    *(
        Case(
            f"GNSS speed x {factor:g}",
            gnss=_times(factor),
            alarm="gnss_speed_wrong",
            by_s=(28.0, inf),
        )
        for factor in (0.8, 1.2)
    ),
    *(
        Case(
            f"GNSS speed x {factor:g}",
            gnss=_times(factor),
            alarm="gnss_speed_wrong",
            by_s=(4.0, 10.0),
        )
        for factor in (2.0, 4.0)
    ),
    Case(
        "shaft runs away, 95 r/min",
        drives=lambda it: DriveRunaway(shaft_rpm=RUNAWAY_RPM),
        alarm="shaft_far_off",
        by_s=(3.0, 3.0),
    ),
    Case(
        "shaft turns 36 % too fast",
        effect=f"shaft.gain=36@{ONSET_S:g}",
        alarm="shaft_far_off",
        by_s=(3.0, 3.0),
    ),
    Case(
        "shaft turns 36 % too slowly",
        effect=f"shaft.gain=-36@{ONSET_S:g}",
        alarm="shaft_far_off",
        by_s=(3.0, 3.0),
    ),
    Case(
        "shaft turns 18 % too slowly",
        effect=f"shaft.gain=-18@{ONSET_S:g}",
        alarm="rate_off",
        by_s=(4.0, 4.0),
    ),
    Case("shaft jams", effect=f"shaft.stall=1@{ONSET_S:g}", alarm="shaft_far_off", by_s=(3.0, 3.0)),
    Case(
        "gate stuck 3 mm too wide, of 9 mm", drives=_gate_off, alarm="gate_far_off", by_s=(3.0, 3.0)
    ),
    Case(
        "gate stuck 3 mm too wide, of 18 mm",
        drives=_gate_off,
        rate_kg_ha=400.0,
        alarm="gate_off",
        by_s=(3.0, 3.0),
    ),
    Case(
        "gate 3 mm too wide, of 18 mm, follows",
        effect=f"gate.home_error=3@{ONSET_S:g}",
        rate_kg_ha=400.0,
        alarm="gate_off",
        by_s=(3.0, 3.0),
    ),
)
# at most, on the ground, where the drives still obey and the fault can be seen
OVER_PERCENT = 20.0
# it turns on whatever it is commanded: the hard-wired stop's case
NOT_STOPPED = ("shaft runs away, 95 r/min",)

# A healthy machine: passes of 100 m, so many turns, a refill now and then; what drives and
# wheels usually have.
HEALTHY: dict[str, tuple[bool, tuple[str, ...], dict[str, Any]]] = {
    "RTK, slip 10 %, slope 6 degrees": (
        False,
        ("speed.wheel_slip=10",),
        {"slope_deg": 6.0, "roughness_deg": 1.0},
    ),
    "plain GNSS, slip 10 %, slope 6 degrees": (True, ("speed.wheel_slip=10",), {"slope_deg": 6.0}),
    "RTK, slow shaft, play of the gate": (
        False,
        ("shaft.slow=0.2", "gate.backlash=1.5", "speed.gnss_latency=0.8"),
        {},
    ),
    "plain GNSS, weak battery, late shaft": (
        True,
        ("shaft.voltage_sag=7", "shaft.gain=-8", "shaft.dead_time=0.15", "speed.wheel_radius=4"),
        {},
    ),
}
HEALTHY_SIM: dict[str, Any] = {
    "pass_length_m": 100.0,
    "hopper_kg": 120.0,
    "passes": 1000,
    "speed_wander_percent": 5.0,
}
BURST_PERCENT, BURST_S, BURST_EVERY_S = 20.0, (1.0, 6.0), 60.0
HEARD_OF = {
    "speeds_differ",
    "wheel_too_much",
    "wheel_too_little",
    "gnss_speed_wrong",
    "wheel_fault",
    "position_walks",
    "shaft_far_off",
    "gate_far_off",
    "gate_off",
    "shaft_turns",
    "gate_opens",
    "rate_far_off",
}


class Found(NamedTuple):
    ground_percent: float  # of the product that the twin gave, more or less
    said: tuple[tuple[str, float], ...]  # alarm, seconds after the onset
    state: str


def _driven(
    case: Case, plain: bool, fault: bool
) -> tuple[float, tuple[tuple[str, float], ...], str]:
    """Kilograms that left in the 30 s, alarms, state."""
    changes = [{"at_s": at_s, "speed_kmh": 3.6 * mps} for at_s, mps in case.speeds]
    lie = Sensors(plain, *(case.wheel, case.gnss) if fault else ())
    it = Rig(
        lie=lie,
        effects=[case.effect] if case.effect and fault else (),
        **SIM,
        speed_changes=changes,
    )
    it.order(Do.MANUAL_RATE, case.rate_kg_ha)
    it.order(Do.SOURCE, TargetSource.MANUAL.value)
    it.work(ONSET_S - 4.0)
    it.run(ONSET_S - it.now_s)
    before, from_kg, first = {a.id for a in it.ticks[-1].alarms}, it.hopper_kg, len(it.ticks)
    if case.drives and fault:
        it.runaway = case.drives(it)
    it.run(LASTS_S)
    said: dict[str, float] = {}
    for k, tick in enumerate(it.ticks[first:]):
        for alarm in tick.alarms:
            if alarm.id not in before:
                said.setdefault(alarm.id, round((k + 1) * DT_S, 2))
    return from_kg - it.hopper_kg, tuple(said.items()), str(it.ticks[-1].row.state)


@cache
def _twin_kg(speeds: tuple[tuple[float, float], ...], plain: bool, rate_kg_ha: float) -> float:
    return _driven(Case("twin", speeds=speeds, rate_kg_ha=rate_kg_ha), plain, False)[0]


def found(case: Case, plain: bool) -> Found:
    kg, said, state = _driven(case, plain, True)
    twin_kg = _twin_kg(case.speeds, plain, case.rate_kg_ha)
    return Found(100.0 * (kg / twin_kg - 1.0), said, state)


def healthy(name: str, seconds: float) -> tuple[dict[str, int], float]:
    """Alarms of `HEARD_OF` and how often they came up, and the seconds with flow. Its operator
    starts again after each refill."""
    plain, effects, sim = HEALTHY[name]
    rng, ends_s = np.random.default_rng(11), [0.0]

    def wheel(mps: float) -> float:
        if rng.random() < DT_S / BURST_EVERY_S:
            ends_s[0] = it.now_s + rng.uniform(*BURST_S)
        return mps * (1.0 + BURST_PERCENT / 100.0) if it.now_s < ends_s[0] else mps

    it = Rig(lie=Sensors(plain, wheel, begin_s=0.0), effects=effects, **(HEALTHY_SIM | sim))
    said: dict[str, int] = {}
    before: set[str] = set()
    flowing = 0
    for _ in range(round(seconds / DT_S)):
        tick = it.run(DT_S)
        del it.ticks[:-1]
        state = tick.row.state
        if state == State.OFF:
            it.order(Do.READY)
        elif state == State.READY or (state == State.HELD and (tick.sensed.speed_mps or 0.0) > 0.6):
            it.loop.handle_order(Order(Do.ACKNOWLEDGE, ""))
            it.loop.handle_order(Order(Do.START))
        flowing += not tick.why_no_flow
        now = {alarm.id for alarm in tick.alarms} & HEARD_OF
        for alarm in now - before:
            said[alarm] = said.get(alarm, 0) + 1
        before = now
    return said, flowing * DT_S


def promised(case: Case, plain: bool, one: Found) -> dict[str, object]:
    who, by_s = f"{case.name}, {'plain' if plain else 'RTK'}", case.by_s[plain]
    promises: dict[str, object] = {
        f"{who}: {one.ground_percent:+.0f} % on the ground: at most +{OVER_PERCENT:g} %": case.name
        in NOT_STOPPED
        or one.ground_percent <= OVER_PERCENT
    }
    if case.alarm and by_s < inf:
        promises[f"{who}: {case.alarm} within {by_s:g} s of {dict(one.said)}"] = (
            dict(one.said).get(case.alarm, inf) <= by_s
        )
    return promises


def main() -> int:
    given = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    given.add_argument("--only", default="", help="cases whose name contains this")
    given.add_argument("--hours", type=float, default=10.0)
    asked = given.parse_args()
    promises: dict[str, object] = {}
    print(
        "| what is wrong | fix | on the ground, 30 s | said after s | state then "
        "|\n|---|---|---|---|---|"
    )
    for case in CASES:
        for plain in (False, True):
            if asked.only in case.name:
                one = found(case, plain)
                said = ", ".join(f"{alarm} {s:.2f}" for alarm, s in one.said) or "never"
                print(
                    f"| {case.name} | {'plain' if plain else 'RTK'} | "
                    f"{one.ground_percent:+.0f} % | {said} | "
                    f"{one.state} |",
                    flush=True,
                )
                promises |= promised(case, plain, one)
    for name in HEALTHY if asked.only in "healthy" else ():
        seconds = 3600.0 * asked.hours / len(HEALTHY)
        heard, flowing_s = healthy(name, seconds)
        print(
            f"healthy, {name}: {seconds / 3600.0:.2f} h, {flowing_s / 3600.0:.2f} h with "
            "flow, alarms: "
            f"{heard or 'none'}",
            flush=True,
        )
        promises[f"healthy, {name}: {heard}: no alarm"] = not heard
        promises[f"healthy, {name}: with flow for half of it"] = flowing_s > 0.5 * seconds
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())

"""GNSS that walks off: how far it is believed, and how often a sound receiver is accused.

    python -m benchmarks position_walks [--hours 10] [--recordings FOLDER]

1. A machine at 1.25 m/s; after a minute its place drifts, at right angles to the way, while the
   receiver tells the same quality, speed and course as before ("place"), or speed and course of
   the drift as well ("all"). Printed: how far it was believed, and after how many seconds it
   was said.
2. Recordings of receivers (NMEA 0183): epochs, and those that were called a walk.
3. Simulated hours of six receivers on a machine that works passes, turns, stops, backs up,
   loses GNSS, slips, and whose wheel is calibrated wrongly: epochs, and those that were called
   a walk.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from math import cos, exp, hypot, radians, sin, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
from topdress.control.geodesy import TangentPlane
from topdress.control.readings import GnssFix, Measurements, Reading, RefusedSpeed
from topdress.control.safety import SafetyLimits
from topdress.control.sensing import SensedMotion, Sensing
from topdress.drivers.devices.gnss import GnssDecoder
from verdict import exit_code

PLANE = TangentPlane(48.0, 11.0)
TICK_S = 0.05
# ahead of the axle; of the wheel to the right of its middle
ANTENNA_M, WHEEL_RIGHT_M = 1.0, 0.8
DRIFTS_MPS = (0.1, 0.25, 0.5, 3.0, 10.0, 30.0)
# by fix quality, within a minute: docs/safety.md
SEEN_FROM_MPS = {4: 0.25, 5: 0.5, 2: 0.5, 1: 1.0}
BEFORE_S, LOOKED_S = 60.0, 90.0
# its first places jump by 33 m while it tells 0.15 m/s
COLD_STARTS = ("beidou-bd.log",)


class Receiver(NamedTuple):
    """How a receiver errs. Places: white noise, and a slow part of that s.d. and correlation;
    speeds: noise, delay, the step in which they are reported, below which speed it reports
    none."""

    name: str
    quality: int
    hz: float
    white_m: float
    slow_m: float
    slow_s: float
    speed_mps: float
    late_s: float
    step_mps: float = 0.0
    cut_mps: float = 0.0
    hdop: float = 0.8


RECEIVERS = (
    Receiver("RTK fixed, 10 Hz", 4, 10.0, 0.01, 0.015, 60.0, 0.03, 0.1),
    Receiver("RTK fixed, 5 Hz, smoothed speed", 4, 5.0, 0.015, 0.02, 120.0, 0.02, 0.8, 0.01, 0.1),
    Receiver("RTK float, 5 Hz", 5, 5.0, 0.03, 0.35, 120.0, 0.04, 0.3, 0.01, 0.1),
    Receiver("SBAS, 5 Hz", 2, 5.0, 0.10, 0.50, 180.0, 0.05, 0.4, 0.051, 0.15),
    Receiver("SBAS, 1 Hz, tenths of a knot", 2, 1.0, 0.15, 0.60, 180.0, 0.06, 1.0, 0.051, 0.2),
    Receiver("plain, 1 Hz, tenths of a knot", 1, 1.0, 0.30, 1.80, 120.0, 0.10, 1.0, 0.051, 0.2),
)


class Moving(NamedTuple):
    """The machine at a tick: place and velocity of the antenna, wheel speed."""

    east_m: float
    north_m: float
    speed_mps: float
    course_deg: float
    wheel_mps: float
    spins: bool = False


def straight(seconds: float, speed_mps: float = 1.25) -> Iterator[Moving]:
    for k in range(round(seconds / TICK_S)):
        yield Moving(0.0, speed_mps * k * TICK_S, speed_mps, 0.0, speed_mps)


def worked(seconds: float, rng: np.random.Generator) -> Iterator[Moving]:
    """Passes of 150 to 350 m and turns, in which the antenna swings out and the wheel at one
    side rolls another way; stops, backing up; the wheel slips 0 to 10 %, in bursts 20 %, now
    and then it spins for some seconds, and it is calibrated up to 4 % wrongly."""
    east = north = course = 0.0
    wrong, speed = 1.0 + rng.uniform(-0.04, 0.04), 0.0
    plan = _plan(rng)
    wanted, turn, left_s, spins = next(plan)
    slip = burst_s = 0.0
    for _ in range(round(seconds / TICK_S)):
        left_s -= TICK_S
        if left_s <= 0.0:
            wanted, turn, left_s, spins = next(plan)
        speed += max(-0.8 * TICK_S, min(0.5 * TICK_S, wanted - speed))
        burst_s = rng.uniform(1.0, 6.0) if rng.random() < TICK_S / 60.0 else burst_s - TICK_S
        slip += (
            (0.2 - slip) * TICK_S / 0.5
            if burst_s > 0.0
            else (rng.uniform(0.0, 0.10) - slip) * TICK_S / 5.0
        )
        course += turn * TICK_S * (1.0 if speed >= 0.0 else -1.0)
        east += speed * sin(radians(course)) * TICK_S
        north += speed * cos(radians(course)) * TICK_S
        ahead, right = (
            (sin(radians(course)), cos(radians(course))),
            (cos(radians(course)), -sin(radians(course))),
        )
        turned = radians(turn) * (1.0 if speed >= 0.0 else -1.0) if speed else 0.0
        east_mps, north_mps = (
            speed * a + ANTENNA_M * turned * r for a, r in zip(ahead, right, strict=True)
        )
        wheel = abs(speed + WHEEL_RIGHT_M * -turned) * (1.0 + slip) * wrong + (
            1.5 if spins else 0.0
        )
        yield Moving(
            east + ANTENNA_M * ahead[0],
            north + ANTENNA_M * ahead[1],
            hypot(east_mps, north_mps),
            float(np.degrees(np.arctan2(east_mps, north_mps))) % 360.0,
            wheel,
            spins,
        )


def _plan(rng: np.random.Generator) -> Iterator[tuple[float, float, float, bool]]:
    """Wanted speed, degrees a second, for how long, and whether the wheel spins."""
    side = 1.0
    while True:
        speed = rng.uniform(0.8, 3.3)
        length_m = rng.uniform(150.0, 350.0)
        for share in (0.4, 0.3, 0.3):
            yield speed, rng.normal(0.0, 0.3), share * length_m / speed, False
            if rng.random() < 0.1:
                yield speed, 0.0, rng.uniform(1.0, 4.0), True
            if rng.random() < 0.15:
                yield 0.0, 0.0, rng.uniform(5.0, 90.0), False
            speed = max(0.6, speed * rng.uniform(0.7, 1.3))
        slow = rng.uniform(0.7, 1.8)
        if rng.random() < 0.3:  # a turn in three parts, backing up
            rate = 20.0 * side
            yield slow, rate, 90.0 / abs(rate), False
            yield 0.0, 0.0, 2.0, False
            yield -0.6, rate, 3.0, False
            yield 0.0, 0.0, 2.0, False
            yield slow, rate, 90.0 / abs(rate), False
        else:
            rate = side * rng.uniform(10.0, 35.0)
            yield slow, rate, 180.0 / abs(rate), False
        side = -side


class Reports:
    """Fixes of a receiver that watches a machine. `drift`: of the place, east, m; `with_it`: of
    its speed, m/s."""

    def __init__(self, receiver: Receiver, rng: np.random.Generator) -> None:
        self._r, self._rng = receiver, rng
        self._slow = rng.standard_normal(2) * receiver.slow_m
        self._velocities: list[tuple[float, float]] = []
        self._next_s = 0.0

    def fix(
        self, now_s: float, at: Moving, drift_m: float = 0.0, drift_mps: float = 0.0
    ) -> GnssFix | None:
        r, normal = self._r, self._rng.standard_normal
        east_mps = at.speed_mps * sin(radians(at.course_deg)) + drift_mps
        north_mps = at.speed_mps * cos(radians(at.course_deg))
        self._velocities.append((east_mps, north_mps))
        late = round(r.late_s / TICK_S)
        if len(self._velocities) > late + 1:
            del self._velocities[0]
        keep = exp(-TICK_S / r.slow_s)
        self._slow = keep * self._slow + sqrt(1.0 - keep * keep) * r.slow_m * normal(2)
        if now_s < self._next_s - 1e-9:
            return None
        self._next_s += 1.0 / r.hz
        noise = r.white_m * normal(2) + self._slow
        lat, lon = PLANE.convert_to_deg(at.east_m + drift_m + noise[0], at.north_m + noise[1])
        east_mps, north_mps = (
            v + r.speed_mps * n for v, n in zip(self._velocities[0], normal(2), strict=True)
        )
        speed = hypot(east_mps, north_mps)
        if r.step_mps:
            speed = round(speed / r.step_mps) * r.step_mps
        course = np.degrees(np.arctan2(east_mps, north_mps)) % 360.0
        if speed < r.cut_mps:
            speed, course = 0.0, None
        return GnssFix(
            now_s, lat, lon, r.quality, 14, r.hdop, speed, None if course is None else float(course)
        )


class Believed(NamedTuple):
    far_m: float  # the place in use was off by this much at most
    said_s: float | None  # after the drift began


def held_by(sensed: SensedMotion) -> bool:
    """Whether safety holds work because nothing says which speed is wrong."""
    doubt = sensed.doubt
    return (
        doubt is not None
        and doubt.refused is RefusedSpeed.EITHER
        and doubt.differed_s - doubt.since_s >= SafetyLimits().speeds_differ_s
    )


def drifting(receiver: Receiver, drift_mps: float, with_it: bool, seed: int = 1) -> Believed:
    reports, sensing = Reports(receiver, np.random.default_rng(seed)), Sensing(0.0, PLANE)
    fix, far_m, said_s = None, 0.0, None
    for k, at in enumerate(straight(BEFORE_S + LOOKED_S)):
        now_s = k * TICK_S
        since_s = max(0.0, now_s - BEFORE_S)
        new = reports.fix(
            now_s, at, drift_mps * since_s, drift_mps if with_it and since_s > 0.0 else 0.0
        )
        fix = new or fix
        sensed = sensing.sense_motion(
            Measurements(now_s, gnss=fix, wheel_speed_mps=Reading(at.wheel_mps, now_s))
        )
        if since_s <= 0.0 or sensed.east_m is None or sensed.north_m is None:
            continue
        held = held_by(sensed)
        if said_s is None and (sensed.refused_m is not None or held):
            said_s = since_s
        if said_s is None or (sensed.position_ok and not held):
            far_m = max(far_m, hypot(sensed.east_m - at.east_m, sensed.north_m - at.north_m))
    return Believed(far_m, said_s)


class Heard(NamedTuple):
    epochs: int
    refused: int  # by one epoch, as before
    walks: int  # spells
    walk_epochs: int
    doubts: frozenset[tuple[RefusedSpeed, float]]  # which speed was not believed, from when on
    spun_s: tuple[float, ...] = ()  # when the wheel spun

    def doubted(self, refused: RefusedSpeed) -> list[float]:
        return [from_s for one, from_s in self.doubts if one is refused]

    @property
    def wheel_unspun(self) -> int:
        """Times that the wheel was not believed though it had not spun in the five seconds
        before."""
        return sum(
            not any(from_s - 5.0 < at_s <= from_s for at_s in self.spun_s)
            for from_s in self.doubted(RefusedSpeed.WHEEL)
        )


def heard(fixes: Iterator[tuple[float, GnssFix, Reading | None]]) -> Heard:
    """What becomes of fixes, each with the time at which it was heard."""
    sensing = Sensing(0.0, None)
    epochs = refused = walks = walk_epochs = 0
    before, seen_s, doubts = False, None, set()
    for now_s, fix, wheel in fixes:
        sensed = sensing.sense_motion(Measurements(now_s, gnss=fix, wheel_speed_mps=wheel))
        if sensed.doubt is not None and (
            sensed.doubt.refused is not RefusedSpeed.EITHER or held_by(sensed)
        ):
            doubts.add((sensed.doubt.refused, sensed.doubt.since_s))
        if fix.time_s == seen_s:
            continue
        seen_s = fix.time_s
        epochs += 1
        refused += sensed.refused_m is not None and not sensed.walks
        walk_epochs += sensed.walks
        walks += sensed.walks and not before
        before = sensed.walks
    return Heard(epochs, refused, walks, walk_epochs, frozenset(doubts))


def recorded(path: Path, hz: float = 1.0) -> Iterator[tuple[float, GnssFix, Reading | None]]:
    """A recording as its receiver sent it, an epoch after the other by its own clock."""
    decoder = GnssDecoder()
    now_s, clock = 0.0, None
    for line in path.read_bytes().splitlines(keepends=True):
        for fix in decoder.feed(line, now_s):
            reports = None if fix.utc is None else np.datetime64(fix.utc.rstrip("Z"), "ms")
            step_s = (
                1.0 / hz
                if reports is None or clock is None
                else (reports - clock) / np.timedelta64(1, "s")
            )
            clock = reports
            now_s += step_s if 0.0 < step_s < 60.0 else 1.0 / hz
            yield now_s, fix._replace(time_s=now_s), None


def hour(receiver: Receiver, seconds: float, seed: int) -> Heard:
    """A stretch of work, with gaps of 0.3 to 20 s every few minutes, in which the wheel goes on."""
    rng, spun_s = np.random.default_rng(seed), []

    def fixes() -> Iterator[tuple[float, GnssFix, Reading | None]]:
        reports, fix, gap_from_s = Reports(receiver, rng), None, 60.0
        gap_s = rng.uniform(0.3, 20.0)
        for k, at in enumerate(worked(seconds, rng)):
            now_s = k * TICK_S
            new = reports.fix(now_s, at)
            if at.spins:
                spun_s.append(now_s)
            if now_s >= gap_from_s + gap_s:
                gap_from_s, gap_s = now_s + rng.uniform(60.0, 400.0), rng.uniform(0.3, 20.0)
            if new is not None and not gap_from_s <= now_s < gap_from_s + gap_s:
                fix = new
            if fix is not None:
                yield now_s, fix, Reading(at.wheel_mps, now_s)

    return heard(fixes())._replace(spun_s=tuple(spun_s))


def main() -> int:
    given = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    given.add_argument("--hours", type=float, default=10.0)
    given.add_argument("--recordings", type=Path)
    asked = given.parse_args()
    promises: dict[str, object] = {}
    print("| receiver | what drifts | m/s | believed for m | said after s |\n|---|---|---|---|---|")
    for receiver in (RECEIVERS[0], RECEIVERS[3], RECEIVERS[5]):
        for with_it in (False, True):
            for drift in DRIFTS_MPS:
                found = drifting(receiver, drift, with_it)
                said = "never" if found.said_s is None else f"{found.said_s:.1f}"
                print(
                    f"| {receiver.name} | {'all' if with_it else 'place'} | {drift:g} | "
                    f"{found.far_m:.1f} | {said} |",
                    flush=True,
                )
                if not with_it and drift >= SEEN_FROM_MPS[receiver.quality]:
                    promises[f"{receiver.name}, {drift:g} m/s: said within a minute"] = (
                        found.said_s is not None and found.said_s <= 60.0
                    )
    for path in sorted(asked.recordings.glob("*.log")) if asked.recordings else ():
        was = heard(recorded(path))
        print(
            f"recording {path.name}: {was.epochs} epochs, {was.refused} refused, {was.walks} walks "
            f"({was.walk_epochs} epochs)",
            flush=True,
        )
        most = 1 if path.name in COLD_STARTS else 0
        promises[f"{path.name}: {was.walks} walks: at most {most}"] = was.walks <= most
    for number, receiver in enumerate(RECEIVERS):
        seconds = 3600.0 * asked.hours / len(RECEIVERS)
        was = hour(receiver, seconds, 10 + number)
        print(
            f"{receiver.name}: {seconds / 3600.0:.2f} h, {was.epochs} epochs, {was.refused} "
            f"refused, {was.walks} "
            f"walks ({was.walk_epochs} epochs); not believed: the wheel "
            f"{len(was.doubted(RefusedSpeed.WHEEL))} times, "
            f"{was.wheel_unspun} of them though it did not spin; GNSS's speed "
            f"{len(was.doubted(RefusedSpeed.GNSS))}; open "
            f"{len(was.doubted(RefusedSpeed.EITHER))}",
            flush=True,
        )
        promises[f"{receiver.name}: {was.walks} walks: none"] = was.walks == 0
        promises[
            f"{receiver.name}: a wheel that did not spin, or GNSS's speed, accused, or work "
            "held: never"
        ] = not was.wheel_unspun and {one for one, _ in was.doubts} <= {RefusedSpeed.WHEEL}
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())

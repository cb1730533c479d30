"""How accurate is point mode over a row of plants, on a machine whose delays its controller does
not know?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from topdress.control.machine.model_elements import Array
from topdress.control.targets.plant_places import PlantRow, TrackedPlant
from topdress.control.targets.point_mode import DoseThreshold, PointLag, PointMode

# Begin and end of the camera's picture beyond its own place, m.
PICTURE_FROM_M, PICTURE_TO_M = 0.2, 1.2


class PointTruth(NamedTuple):
    """Holds what the controller does not know: standard deviations and constants."""

    link_sd_s: float = 0.03
    extra_delay_s: float = 0.15
    lever_arm_m: float = 0.04
    # Standard deviation of the dose's middle on the ground, m.
    place_sd_m: float = 0.015
    # Standard deviation of a plant's position in the picture, m.
    seen_sd_m: float = 0.01
    # Relative error of the wheel's distance, %.
    odometer_percent: float = 0.3
    # Standard deviation of the filtered speed, m/s, with a correlation time of 0.25 s.
    speed_sd_mps: float = 0.01
    # Standard deviation of the errors from which the threshold is learnt, m.
    measured_sd_m: float = 0.01


class PointRun(NamedTuple):
    """Holds the result. error_m: (doses,) middle of the dose minus its plant, late positive, in
    the order of the doses."""

    error_m: Array
    plants: int
    missed: int
    # Threshold of each dose, m: (doses,).
    threshold_m: Array


def simulate_point_run(
    lag: PointLag,
    spacing_m: float,
    speed_mps: float,
    plants: int,
    seed: int,
    learn: bool = True,
    *,
    truth: PointTruth | None = None,
    camera_m: float | None = None,
    vision_s: float = 1.5,
    wander_percent: float = 3.0,
    tick_s: float = 0.02,
    within_tick: bool = True,
    measured_after: int = 10,
) -> PointRun:
    """Simulates a drive over a row.

    Parameters
    ----------
    learn : the threshold follows the measured errors, known `measured_after` doses later.
    camera_m : the camera's place before the outlet, m; None: far enough for lag and computing
        time.
    within_tick : the dose command has its moment; otherwise it is given at the tick.

    The way is straight; the speed wanders with a 4 s correlation."""
    really = truth or PointTruth()
    rng = np.random.default_rng(seed)
    places = 5.0 + spacing_m * np.arange(plants) + 0.1 * spacing_m * rng.standard_normal(plants)
    places.sort()
    camera = (
        lag.find_distance_m(1.3 * speed_mps) + 1.3 * speed_mps * vision_s + 0.5
        if camera_m is None
        else camera_m
    )
    row = PlantRow()
    mode = PointMode(lag, row, DoseThreshold())
    way, odometer, now, wander, off = 0.0, 0.0, 0.0, 0.0, 0.0
    ways = [0.0]
    waiting: list[tuple[float, list[TrackedPlant]]] = []
    ordered: list[tuple[float, float, float, float]] = []
    found: list[float] = []
    thresholds: list[float] = []
    learned = 0
    scale = 1.0 + really.odometer_percent / 100.0
    settle_m = lag.find_distance_m(2.0 * speed_mps) + 1.0
    while way < places[-1] + settle_m:
        wander += (
            -wander * tick_s / 4.0
            + wander_percent / 100.0 * (2.0 * tick_s / 4.0) ** 0.5 * rng.standard_normal()
        )
        speed = speed_mps * (1.0 + wander)
        way += speed * tick_s
        odometer += speed * tick_s * scale
        now += tick_s
        ways.append(way)
        in_view = places[
            (places > way + camera + PICTURE_FROM_M) & (places < way + camera + PICTURE_TO_M)
        ]
        looks = in_view - way + really.seen_sd_m * rng.standard_normal(len(in_view))
        waiting.append((now + vision_s, [TrackedPlant(odometer, float(ahead)) for ahead in looks]))
        while waiting and waiting[0][0] <= now:
            row.add_plants(waiting.pop(0)[1], mode.fixed_to_m)
        off += (
            -off * tick_s / 0.25
            + really.speed_sd_mps * (2.0 * tick_s / 0.25) ** 0.5 * rng.standard_normal()
        )
        measured_mps = max(0.0, speed + off)
        doses, _ = mode.plan_doses(now, odometer, measured_mps, tick_s)
        for dose in doses:
            begins = now + (dose.in_s if within_tick else 0.0)
            lands = (
                begins
                + lag.link_s
                + really.link_sd_s * rng.standard_normal()
                + really.extra_delay_s
                + 0.5 * lag.turn_s
                + lag.fall_s
            )
            ordered.append((lands, dose.plant_m, dose.threshold_m, dose.speed_mps))
        while learned < len(ordered) and ordered[learned][0] < now:
            lands, plant, threshold, _ = ordered[learned]
            ticks = int(lands / tick_s)
            at = ways[ticks] + (lands / tick_s - ticks) * (ways[ticks + 1] - ways[ticks])
            landed = at + really.lever_arm_m + really.place_sd_m * rng.standard_normal()
            error = landed - float(places[np.argmin(np.abs(places * scale - plant))])
            found.append(error)
            thresholds.append(threshold)
            learned += 1
            known = learned - 1 - measured_after
            if learn and known >= 0:
                mode.threshold.learn_error(
                    found[known] + really.measured_sd_m * rng.standard_normal(),
                    ordered[known][3],
                    ordered[known][2],
                )
    return PointRun(np.array(found), plants, plants - len(found), np.array(thresholds))

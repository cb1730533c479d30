"""The point paper: delays, shaft speeds by microstep, and where doses land, which it planned but does not print."""
from __future__ import annotations

import numpy as np

from control.simulation.point_run import point_run
from control.targets.point import fastest_mps, point_lag

from .claims import ledger
from .claims_points import FALL_M, SHAFT_RPM, STEPS_A_TURN, TURN_DEG, points_claims, pulse_rate_s
from .page import Line, Picture, Section, Table
from .published import MICROSTEPS, POINT_DELAYS_S

SPACINGS_M = (0.2, 0.25, 0.3)
SPEEDS_MPS = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0)


def points_section(plants: int = 200) -> Section:
    """Everything of the paper, published next to obtained; dose placement on a simulated row of plants."""
    table, picture = placement(plants)
    claims = tuple(points_claims(point_lag(TURN_DEG, SHAFT_RPM, FALL_M)))
    return Section("Point fertilisation: one dose a plant", (
        "The paper describes a placement test but prints no errors. Ours: a row of plants seen by a simulated camera, "
        "a machine with 0.15 s and 0.04 m that control does not know, 3 % wander of the speed. A dose ends before the "
        "next begins, so that misses begin at spacing over turning time.",
        "Eq 3 as printed lacks the factor 6 (degrees over r/min): 120 degrees at 99.8 r/min would be 1.2 s and not "
        "the 0.2 s that section 2.3 uses."), (ledger("point paper", claims), delays(), microsteps(), table),
        (turning_picture(), picture), claims)


def delays() -> Table:
    lag = point_lag(TURN_DEG, SHAFT_RPM, FALL_M, POINT_DELAYS_S["vision"], POINT_DELAYS_S["link"])
    ours = {"turn": (lag.turn_s, "recomputed, eq 3"), "fall": (lag.fall_s, "recomputed, eq 4"),
            "total": (lag.total_s, "recomputed, two parts copied")}
    return Table("Delays of a dose, s (eq 1 to 5)", ("part", "published", "obtained", "how"),
                 tuple((part, value, *ours.get(part, (None, "copied"))) for part, value in POINT_DELAYS_S.items()),
                 (0, 2, 3, 0))


def microsteps() -> Table:
    pulses = pulse_rate_s()
    return Table(f"Table 1: shaft speed by microstep mode, r/min; one pulse rate fitted to the three: {pulses:.0f} "
                 f"per s",
                 ("mode", "published", "fitted"),
                 tuple((mode, rpm, 60.0 * pulses / (STEPS_A_TURN * mode)) for mode, rpm in MICROSTEPS.items()),
                 (0, 1, 1))


def turning_picture() -> Picture:
    """Figure 4: the time of a turn at each microstep mode, 6 n degrees a second."""
    kinds = ("published", "other", "ours")
    return Picture("Figure 4: turning time over angle (recomputed from table 1's shaft speeds)", "angle, degrees",
                   "time, s", tuple(Line(f"mode {mode}, {rpm:g} r/min", kind, [0.0, 360.0], [0.0, 60.0 / rpm], True)
                                    for (mode, rpm), kind in zip(MICROSTEPS.items(), kinds, strict=True)))


def placement(plants: int) -> tuple[Table, Picture]:
    lag = point_lag(TURN_DEG, SHAFT_RPM, FALL_M)
    rows = []
    missed: dict[float, list[float]] = {}
    for spacing in SPACINGS_M:
        for speed in SPEEDS_MPS:
            cells: list[float] = []
            for learn in (False, True):
                run = point_run(lag, spacing, speed, plants, 1, learn)
                size = np.abs(run.error_m[len(run.error_m) // 3:])
                cells += [float(np.median(size)), float(np.percentile(size, 95))]
            share = 100.0 * run.missed / plants
            missed.setdefault(spacing, []).append(share)
            rows.append((spacing, fastest_mps(spacing, lag.turn_s), speed, *cells, share))
    return (Table("Dose error, m, without and with the learned threshold, and doses missed, %",
                  ("spacing m", "limit m/s", "speed m/s", "p50 without", "p95", "p50 with", "p95", "missed %"),
                  tuple(rows), (2, 2, 2, 3, 3, 3, 3, 1)),
            Picture("Doses missed", "speed, m/s", "missed, %", tuple(
                Line(f"{spacing:g} m", kind, list(SPEEDS_MPS), missed[spacing], True)
                for spacing, kind in zip(SPACINGS_M, ("published", "other", "ours"), strict=True))))

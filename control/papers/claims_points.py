"""Every claim of the point paper, and what comes out."""
from __future__ import annotations

import numpy as np

from control.targets.point import PointLag

from .claims import DIGITS, compared
from .page import Claim, How
from .published import MICROSTEPS, POINT_DELAYS_S

STEPS_A_TURN = 200.0                # 1.8 degrees a full step
TURN_DEG, SHAFT_RPM, FALL_M = 120.0, 99.8, 1.0


def pulse_rate_s() -> float:
    """The one pulse rate that fits table 1 best, 1/s (least squares of relative errors)."""
    return float(np.mean([rpm * mode * STEPS_A_TURN / 60.0 for mode, rpm in MICROSTEPS.items()]))


def points_claims(lag: PointLag) -> list[Claim]:
    """`lag`: a dose of 120 degrees at 99.8 r/min from 1 m."""
    pulses = pulse_rate_s()
    fits = [60.0 * pulses / (STEPS_A_TURN * mode) for mode in MICROSTEPS]
    parts = POINT_DELAYS_S["vision"] + POINT_DELAYS_S["link"] + lag.turn_s + lag.fall_s
    return [
        Claim("eq 1", "time of the vision", "1.5 s", remark="an input: camera and program are not described"),
        Claim("eq 2, abstract", "link of host and slave, the system's mean response", "0.8 s",
              remark="an input; the abstract calls it the response, the text the communication"),
        Claim("eq 3", "120 degrees at 99.8 r/min", "0.2 s", f"{TURN_DEG / SHAFT_RPM:.2f} s as printed; "
              f"{lag.turn_s:.3f} s with the factor 6", How.RECOMPUTED, False,
              "as printed eq 3 lacks the factor 6 (degrees over r/min); section 2.3 used it", f"0.05 s: {DIGITS}"),
        compared("eq 4", "fall from 1 m", POINT_DELAYS_S["fall"], lag.fall_s, 0.005, "{:.2f} s"),
        compared("eq 5, section 2.3", "whole delay", POINT_DELAYS_S["total"], parts, 0.01, "{:.2f} s",
                 remark="the sum of two copied and two computed parts", why="two parts rounded to 0.01 s"),
        Claim("table 1", "shaft speed by microstep mode 1, 2, 4", ", ".join(f"{rpm:g}" for rpm in MICROSTEPS.values())
              + " r/min", ", ".join(f"{rpm:.1f}" for rpm in fits) + f" r/min at {pulses:.0f} pulses/s", How.FITTED,
              max(abs(ours / rpm - 1.0) for ours, rpm in zip(fits, MICROSTEPS.values(), strict=True)) < 0.01,
              "one pulse rate for three speeds: slower modes are microsteps, not slower pulses",
              "1 %: turns timed by a program's clock; no scatter is printed"),
        Claim("table 1", "vibration by mode", "none, slight, marked"),
        Claim("figure 4", "turning time over angle, three modes", "curves without figures",
              ", ".join(f"{TURN_DEG / (6.0 * rpm):.3f}" for rpm in MICROSTEPS.values()) + " s for 120 degrees",
              How.RECOMPUTED, None, "straight lines of 6 n degrees a second; drawn below from table 1, not read off "
              "the figure"),
        Claim("abstract, conclusion 3", "runs stably between", "50 and 201 r/min",
              f"{min(MICROSTEPS.values()):g} and {max(MICROSTEPS.values()):g} r/min", How.RECOMPUTED, True,
              "the ends of table 1, whose slowest mode is said to vibrate markedly", "none: the ends of table 1"),
        Claim("section 1.3.2", "threshold T", "the mean error, without a figure",
              remark="ours is learned from measured doses; its effect is simulated below"),
        Claim("section 1.4.2", "baud rates of slave and host", "2 : 3",
              remark="a clock fault of that board, not a rule; see docs/protocol-slave-board.md"),
        Claim("section 1.2", "pins, modes and currents of board and driver", "18 pins in 9 pairs, 7 modes, 8 currents"),
        Claim("section 2.4", "errors of placed doses", "measured, not printed", remark="simulated below"),
        Claim("figure 1", "hardware", "a diagram; no figures"),
        Claim("figure 2", "flow of control", "a diagram; no figures"),
        Claim("figure 3", "test bench", "a photograph; supply 220 V to 24 V"),
        Claim("figure 5", "sketch of the test in the open", "a sketch; no figures"),
    ]

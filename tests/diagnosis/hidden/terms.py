"""Dependences that no catalogue holds, by class: which variable, of what shape, on which stage
of the machine.

Every term is a signal g of about unit spread times a size. The stage says what it acts on
(STAGES).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

Floats = npt.NDArray[np.float64]
CLASSES = (
    "variable",
    "product",
    "memory",
    "periodic",
    "dead_zone",
    "saturation",
    "side",
    "span",
    "column",
)

# id -> channel, is it a factor (size in %) or added (size in unit), first guess of the size,
# its unit
STAGES: dict[str, tuple[str, bool, float, str]] = {
    "y.shaft": ("shaft", True, 0.3, "%"),
    "y.shaft_rpm": ("shaft", False, 0.3, "r/min"),
    "y.gate": ("gate", False, 0.05, "mm"),
    "y.flow": ("flow", True, 1.0, "%"),
    "y.scale": ("scale", False, 0.2, "kg"),
    "y.wheel": ("speed", True, 0.5, "%"),
}
ANGLE = "shaft_angle"


class Term(NamedTuple):
    """`variables`: as columns of the log, or ANGLE. `centre`, `spread`: of each variable over
    the drive."""

    kind: str  # one of CLASSES
    variables: tuple[str, ...]
    centre: tuple[float, ...]
    spread: tuple[float, ...]
    form: int = 0
    knob: float = 0.5
    tau_s: float = 0.0  # of a memory
    from_s: float = 0.0  # of a span
    to_s: float = 0.0

    def signal(self, values: Mapping[str, Floats], step_s: float) -> Floats:
        """g (samples,) from the variables' values (samples,) on a grid of `step_s`."""
        u = [
            (values[v] - c) / s
            for v, c, s in zip(self.variables, self.centre, self.spread, strict=True)
        ]
        k, one = self.knob, u[0]
        if self.kind == "product":
            return (
                np.asarray(one * u[1])
                if self.form % 2
                else np.asarray(np.tanh(one) * (1.0 + u[1]) / 1.4)
            )
        if self.kind == "memory":
            a = np.exp(-step_s / self.tau_s)
            slow = lfilter([1.0 - a], [1.0, -a], one, zi=[a * one[0]])[0]
            # follows late, or forgets again
            return np.asarray(slow if self.form % 2 else one - slow)
        if self.kind == "periodic":
            turns = 1 + self.form % 2
            angle = values[self.variables[0]] * (
                2 * np.pi if self.variables[0] == ANGLE else np.pi / 180.0
            )
            return np.asarray(np.sin(turns * angle + 2 * np.pi * k))
        if self.kind == "dead_zone":
            if self.form % 2:  # loses a constant of whatever it is told
                return -np.clip(values[self.variables[0]] / (2.0 + 4.0 * k), 0.0, 1.0)
            return np.asarray(np.sign(one) * np.maximum(0.0, np.abs(one) - 0.5 - 0.6 * k))
        if self.kind == "saturation":
            if self.form % 2:  # gives no more above some value
                return -np.maximum(0.0, one - 0.8 * k)
            return np.asarray(np.clip(one, -0.4 - 0.4 * k, 0.2 + 0.4 * k))
        if self.kind == "side":
            if self.form % 2:  # which way it has been moving of late
                a = np.exp(-step_s / 1.5)
                late = one - lfilter([1.0 - a], [1.0, -a], one, zi=[a * one[0]])[0]
                return np.asarray(np.tanh(late / 0.1))
            return np.asarray(np.sign(values[self.variables[0]]))
        if self.kind == "span":
            t = values["time_s"]
            return ((t >= self.from_s) & (t < self.to_s)).astype(float)
        if self.kind == "column":
            return (one, np.tanh(one), one + 0.35 * one**2, np.expm1(0.6 * one) / 0.6)[
                self.form % 4
            ]
        shapes = (
            np.abs(one),
            one**2 - 1.0,
            np.exp(-(((one - k + 0.5) / 0.6) ** 2)),
            (one > k).astype(float),
            np.clip(one, -3, 3) ** 3 / 3.0,
            np.sin(2.2 * one + 6.0 * k),
        )
        return np.asarray(shapes[self.form % len(shapes)])


def dealt(kind: str, values: Mapping[str, Floats], rng: np.random.Generator) -> tuple[str, Term]:
    """A stage and a term of one class. `values`: variables of the drive (rows,), from the first
    to the last row."""
    stages, wanted = choices(kind)[int(rng.integers(len(choices(kind))))]
    stage = str(rng.choice(stages))
    variables = (
        tuple(str(v) for v in rng.permutation(wanted))
        if kind == "product"
        else (str(rng.choice(wanted)),)
    )
    form, knob = int(rng.integers(12)), float(rng.random())
    if kind in ("dead_zone", "side"):  # the form decides what it can depend on
        own = variables[0] in ("shaft_rpm_cmd", "opening_mm_cmd")
        form = 2 * (form // 2) + own
    t = values["time_s"]
    start = float(t[0] + rng.uniform(0.1, 0.7) * (t[-1] - t[0]))
    return stage, term_over(
        kind,
        variables,
        values,
        form,
        knob,
        float(np.exp(rng.uniform(np.log(3.0), np.log(90.0)))),
        start,
        start + float(rng.uniform(0.06, 0.25) * (t[-1] - t[0])),
    )


def term_over(
    kind: str,
    variables: tuple[str, ...],
    values: Mapping[str, Floats],
    form: int,
    knob: float,
    tau_s: float = 0.0,
    from_s: float = 0.0,
    to_s: float = 0.0,
) -> Term:
    known = [values.get(v, np.array([0.0, 1.0])) for v in variables]
    return Term(
        kind,
        variables,
        tuple(float(np.mean(v)) for v in known),
        tuple(max(float(np.std(v)), 1e-6) for v in known),
        form,
        knob,
        tau_s,
        from_s,
        to_s,
    )


def choices(kind: str) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Stages and variables that go together, so that no catalogued effect is meant."""
    return {
        "variable": [
            (("y.flow", "y.wheel"), ("roll_deg", "supply_v")),
            (("y.flow",), ("speed_mps",)),
            (("y.shaft",), ("roll_deg", "pitch_deg", "speed_mps")),
            (("y.gate",), ("roll_deg", "supply_v", "speed_mps")),
            (("y.scale",), ("roll_deg", "supply_v", "speed_mps")),
        ],
        "product": [
            (("y.flow",), ("roll_deg", "speed_mps")),
            (("y.flow", "y.gate"), ("supply_v", "pitch_deg")),
            (("y.wheel",), ("roll_deg", "speed_mps")),
            (("y.shaft", "y.gate"), ("supply_v", "roll_deg")),
            (("y.scale",), ("roll_deg", "pitch_deg")),
        ],
        "memory": [
            (("y.flow", "y.gate", "y.shaft", "y.wheel"), ("supply_v", "roll_deg")),
            (("y.flow",), ("speed_mps", "shaft_rpm_cmd")),
            (("y.scale",), ("speed_mps", "roll_deg")),
        ],
        "periodic": [
            (("y.shaft",), (ANGLE, "heading_deg")),
            (("y.wheel", "y.flow", "y.gate"), ("heading_deg",)),
        ],
        "dead_zone": [
            (("y.shaft_rpm",), ("shaft_rpm_cmd",)),
            (("y.flow", "y.wheel", "y.scale", "y.gate"), ("roll_deg",)),
            (("y.flow",), ("pitch_deg",)),
        ],
        "saturation": [
            (("y.shaft_rpm",), ("shaft_rpm_cmd",)),
            (("y.gate",), ("opening_mm_cmd",)),
            (("y.flow", "y.wheel"), ("roll_deg", "supply_v")),
        ],
        "side": [
            (("y.wheel", "y.flow", "y.scale"), ("roll_deg",)),
            (("y.gate", "y.shaft"), ("pitch_deg", "roll_deg")),
            (("y.flow",), ("shaft_rpm_cmd", "opening_mm_cmd")),
        ],
        "span": [(("y.scale", "y.gate", "y.shaft_rpm"), ("time_s",))],
    }[kind]


def also_right(variable: str) -> tuple[str, ...]:
    """Other columns that say the same as a variable; an answer may name them."""
    return {
        "speed_mps": ("speed_mps", "wheel_speed_mps", "speed_used_mps"),
        "shaft_rpm_cmd": ("shaft_rpm_cmd", "shaft_rpm"),
        "opening_mm_cmd": ("opening_mm_cmd", "opening_mm"),
        ANGLE: (ANGLE, "shaft_angle_deg", "shaft_phase", "shaft_phase_deg", "shaft_turn"),
        "heading_deg": ("heading_deg", "heading"),
    }.get(variable, (variable,))

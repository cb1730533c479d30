"""The made-up rig of docs/notebook.md: a fan on a bench, twice. Run it in this folder to make
the files anew.

It turns 7 % slower than its data sheet says and needs twice the time to answer; the tachometer
is noisy. Not a model of topdress: first order with a dead time, by its exact solution for held
commands.
"""

from __future__ import annotations

import numpy as np

TAU_S, DEAD_S, GAIN, NOISE_RPM, STEP_MS = 0.30, 0.04, 0.93, 6.0, 20


def recording(name: str, seed: int, seconds: float = 60.0) -> None:
    rng = np.random.default_rng(seed)
    ms = np.arange(0, int(1000 * seconds), STEP_MS)
    command = np.repeat(
        rng.uniform(400.0, 2800.0, int(seconds / 2) + 1).round(-1), 2000 // STEP_MS
    )[: len(ms)]
    late = int(round(1000 * DEAD_S / STEP_MS))
    speed, rows = GAIN * command[0], ["millis,fan_command_rpm,tacho_rpm"]
    for k in range(len(ms)):
        rows.append(f"{ms[k]},{command[k]:g},{speed + NOISE_RPM * rng.standard_normal():.1f}")
        speed += (GAIN * command[max(0, k - late)] - speed) * (
            1.0 - np.exp(-0.001 * STEP_MS / TAU_S)
        )
    with open(name, "w", encoding="utf-8") as file:
        file.write("\n".join(rows) + "\n")


if __name__ == "__main__":
    recording("fan-monday.csv", 1)
    recording("fan-friday.csv", 2)

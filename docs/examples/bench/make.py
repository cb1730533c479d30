"""The made-up bench tables of docs/guides/engineer.md. Run it in this folder to make the files
anew.

The roller fills 4 % less than the shipped machine file says (5.28 instead of 5.5 g a turn and
mm); the weights scatter by 0.4 %, the drop times by 15 ms. The drop times are the lag paper's
line (1.83 s - 8.3 ms a r/min, eq 6).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

GRAMS_PER_REV_MM, MASS_SHARE, SECONDS = 5.28, 0.004, 45.0
DROP_S, DROP_S_PER_RPM, TIME_S = 1.8288, -0.0083, 0.015


def catch() -> str:
    """Three openings, three shaft speeds, each three times."""
    rng = np.random.default_rng(1)
    rows = ["shaft_rpm,opening_mm,duration_s,mass_kg"]
    for opening_mm in (10, 25, 40):
        for rpm in (20, 50, 80):
            for _ in range(3):
                mass_kg = GRAMS_PER_REV_MM * opening_mm * rpm / 60.0 * SECONDS / 1000.0
                mass_kg *= 1.0 + MASS_SHARE * rng.standard_normal()
                rows.append(f"{rpm},{opening_mm},{SECONDS:.0f},{mass_kg:.3f}")
    return "\n".join(rows) + "\n"


def lag() -> str:
    """Seven shaft speeds, each four times, out of a standing shaft."""
    rng = np.random.default_rng(2)
    rows = ["shaft_rpm,drop_s"]
    for rpm in (10, 20, 30, 40, 50, 60, 70):
        rows += [
            f"{rpm},{DROP_S + DROP_S_PER_RPM * rpm + TIME_S * rng.standard_normal():.3f}"
            for _ in range(4)
        ]
    return "\n".join(rows) + "\n"


FILES = {"catch.csv": catch, "lag.csv": lag}

if __name__ == "__main__":
    for name, text in FILES.items():
        Path(name).write_text(text(), encoding="utf-8")

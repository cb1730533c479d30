from __future__ import annotations

import sys
from pathlib import Path

# The world is a package of the benchmarks.
sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))

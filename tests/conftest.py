"""Before anything loads numpy: as in the program, matrices get one thread."""
from __future__ import annotations

import pytest

from console.threads import few_for_matrices

few_for_matrices()


def pytest_report_header(config: pytest.Config) -> str | None:
    """Which of the two sets runs: a test of the other one, though named by its path, is only counted as deselected."""
    chosen = config.getoption("markexpr")
    return "the quick set; the rest: -m exam (make exam); both: -m ''" if chosen == "not exam" else None

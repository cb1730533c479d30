"""How hard a drive works, of a log of another machine: a column of the log's, not a nameless one."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from drivers.files.read_log import read_log


@pytest.mark.parametrize(("header", "command", "scale", "column"), [
    ("motor current [mA]", "target rpm", 0.001, "shaft_effort"),
    ("motor_torque_nm", "target rpm", 1.0, "shaft_effort"),
    ("duty [%]", "target rpm", 1.0, "shaft_effort"), ("gate_current_a", "target rpm", 1.0, "gate_effort")])
def test_effort_of_another_machine_is_a_column_of_the_log(header: str, command: str, scale: float, column: str,
                                                          topdress: Callable[..., Result], tmp_path: Path) -> None:
    rows = np.arange(200)
    wanted = 30.0 + 10.0 * (rows // 20 % 3)
    turned = np.concatenate((wanted[:1], wanted[:-1])) + 0.1 * np.sin(rows)
    effort = 400.0 + 3.0 * turned + np.cos(rows)
    path, out = tmp_path / "other.csv", tmp_path / "log.csv"
    path.write_text(f"time [s],{command},actual rpm,{header}\n" + "".join(
        f"{0.1 * k:.1f},{a:g},{b:.3f},{c:.3f}\n" for k, a, b, c in zip(rows, wanted, turned, effort, strict=True)))
    result = topdress("import", path, "--out", out)
    assert result.exit_code == 0, result.output
    log = read_log(out)
    assert np.allclose(log.numbers(column)[:200], scale * effort, atol=6e-4)
    assert np.allclose(log.numbers("shaft_rpm_cmd")[:200], wanted)

"""Each row of the loss table on the virtual machine, through its bytes: the reaction and its time."""
from __future__ import annotations

import pytest

ROWS = ("ndvi_silent", "heads_few", "gnss_silent", "gnss_silent_map", "wheel_stuck", "both_speeds", "board_unplugged",
        "host_silent", "driver_fault", "console_silent", "console_gone", "rate_amber", "rate_red", "bridging",
        "hopper_empty", "hopper_low", "lead_short", "log_failed", "acknowledge")


@pytest.mark.parametrize("name", ROWS)
def test_reaction_in_time(benchmark_module, tmp_path, name):
    found = getattr(benchmark_module("loss_table"), name)(tmp_path)
    assert found.ok, found


def test_no_row_is_left_out(benchmark_module):
    assert tuple(row.__name__ for row in benchmark_module("loss_table").ROWS) == ROWS

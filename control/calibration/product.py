"""What a fit to a catch test says of the product that was caught."""
from __future__ import annotations

import datetime as dt

from control.agronomy.product import CatchTest
from control.calibration.flow_fit import FlowFit
from control.machine.machine import Machine


def catch_test(machine: Machine, fit: FlowFit, date: dt.date, data: str, sha256: str = "") -> CatchTest:
    """The test as the product's file keeps it. machine: it was done with. data, sha256: of the table."""
    grams = fit.grams_per_rev_mm
    return CatchTest(
        date=date, machine=machine.id, grams_per_rev_mm=grams.value, low=grams.low, high=grams.high,
        zero_offset_g_rev=fit.zero_offset_g_rev.value if fit.zero_offset_g_rev else 0.0,
        fill_falloff_percent=fit.fill_falloff_percent.value if fit.fill_falloff_percent else 0.0,
        rows=fit.rows_used, data=data, sha256=sha256)

"""Tests to machine parameters: flow and lag from bench tables, wheel and canopy heads from run
logs.

What fits loads scipy, so it is imported when it is first asked for: to tell a table from a log
takes none of it.

Files:

- `adopt`: What a calibrated machine file says about itself
- `bench_table`: A bench table as a record, and what each kind of table must hold
- `encoder_fit`: Counts of the metering shaft's encoder a turn
- `first_machine`: A first machine file of one driven stage (pump, wheel, fan, conveyor)
- `flow_fit`: Catch test to flow model
- `heads_check`: Canopy heads from a run log
- `lag_fit`: Lag test to lag model: a straight line over shaft speed, with its range
- `least_squares`: Weighted linear least squares with 90 % intervals
- `tube_fit`: Lag test between two rates to what goes on in the tube
- `wheel_fit`: The wheel's circumference from a run log
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .bench_table import KINDS, BenchTable, recognise

if TYPE_CHECKING:
    from .flow_fit import FlowFit, fit_flow
    from .heads_check import HeadFit, HeadsFit, check_heads
    from .lag_fit import LagFit, fit_lag
    from .wheel_fit import WheelFit, WheelLog, fit_wheel

__all__ = [
    "KINDS",
    "BenchTable",
    "FlowFit",
    "HeadFit",
    "HeadsFit",
    "LagFit",
    "WheelFit",
    "WheelLog",
    "check_heads",
    "fit_flow",
    "fit_lag",
    "fit_wheel",
    "recognise",
]

_FITS = {
    "FlowFit": ".flow_fit",
    "fit_flow": ".flow_fit",
    "HeadFit": ".heads_check",
    "HeadsFit": ".heads_check",
    "check_heads": ".heads_check",
    "LagFit": ".lag_fit",
    "fit_lag": ".lag_fit",
    "WheelFit": ".wheel_fit",
    "WheelLog": ".wheel_fit",
    "fit_wheel": ".wheel_fit",
}


def __getattr__(name: str) -> Any:
    if name not in _FITS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_FITS[name], __name__), name)

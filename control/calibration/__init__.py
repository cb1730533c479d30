"""Determines machine parameters from tests: flow and lag from bench tables, wheel and canopy heads
from run logs.

The fits load scipy, so they are imported at their first use; telling a table from a log does not
need them.

Files:

- `bench_table`: Which columns must each kind of bench table have?
- `calibration_record`: What does a calibrated machine file record about its calibration?
- `encoder_fit`: How many counts has a turn of the metering shaft's encoder?
- `first_machine`: Which first machine file of a single driven stage (pump, wheel, fan
- `flow_fit`: Which flow model does a catch test give?
- `heads_check`: Which gain and offset has each canopy head in a run log?
- `lag_fit`: Which lag model does a lag test give?
- `least_squares`: How are linear models fitted?
- `tube_fit`: Does the air stream in the tube carry the granules, or do they fall singly?
- `wheel_fit`: Which circumference has the wheel?
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .bench_table import KINDS, BenchTable, recognise_kind

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
    "recognise_kind",
]

_FIT_MODULES = {
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
    if name not in _FIT_MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_FIT_MODULES[name], __name__), name)

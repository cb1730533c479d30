"""Tests to machine parameters: flow and lag from bench tables, wheel and canopy heads from run logs."""
from .bench_table import KINDS, BenchTable, recognise
from .flow_fit import FlowFit, fit_flow
from .heads_check import HeadFit, HeadsFit, check_heads
from .lag_fit import LagFit, fit_lag
from .wheel_fit import WheelFit, WheelLog, fit_wheel

__all__ = ["KINDS", "BenchTable", "FlowFit", "HeadFit", "HeadsFit", "LagFit", "WheelFit", "WheelLog", "check_heads",
           "fit_flow", "fit_lag", "fit_wheel", "recognise"]

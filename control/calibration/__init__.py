"""Bench tests to machine parameters: the flow from a catch test, the lag from a lag test."""
from .bench_table import KINDS, BenchTable, recognise
from .flow_fit import FlowFit, fit_flow
from .lag_fit import LagFit, fit_lag

__all__ = ["KINDS", "BenchTable", "FlowFit", "LagFit", "fit_flow", "fit_lag", "recognise"]

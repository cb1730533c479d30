"""Diagnosis of bench tables: lag, catch, weigh, heads, place. Small numbers of rows, exact
statistics."""

from topdress.control.calibration.bench_table import BenchTable as Table

from .diagnose import diagnose_tables

__all__ = ["Table", "diagnose_tables"]

"""Diagnosis of bench tables: lag, catch, weigh, heads, place. Small numbers of rows, exact
statistics.

Files:

- `candidates`: What a model of bench tables may be made of
- `clock`: Times that come in steps
- `cross_calibration`: What two tables, or two labels of one
- `diagnose`: Bench tables to a diagnosis
- `duplicate_rows`: Measurements that a second table tells once more
- `gain`: What the rows can show: the held-out gain of what is named, the smallest size of the rest
- `noise`: The noise of one measured column
- `problem`: All pieces of a diagnosis side by side
- `report`: The result of a diagnosis of bench tables
- `rows`: Bench tables as pieces, a section a kind
- `search`: Which models of bench tables are probable
- `table_series`: One measured column of a bench table, and what the machine model says about it
- `verdict`: The verdict on bench tables, from the probabilities of the models
"""

from topdress.control.calibration.bench_table import BenchTable as Table

from .diagnose import diagnose_tables

__all__ = ["Table", "diagnose_tables"]

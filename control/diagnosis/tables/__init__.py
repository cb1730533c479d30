"""Diagnoses bench tables: lag, catch, weigh, heads, place. Small numbers of rows allow exact
statistics.

Files:

- `candidates`: Lists the components of a model of bench tables
- `clock`: Detects times that are quantised by a detector with a coarse clock (lag.coarse_clock)
- `cross_calibration`: Compares two tables, or two labels of a table
- `diagnose`: Diagnoses bench tables: shows errors, names their causes, lists alternatives
- `duplicate_rows`: Removes measurements that a second table repeats
- `gain`: Measures the held-out gain of the named causes
- `noise`: Estimates the noise of one measured column
- `problem`: Joins all pieces of a diagnosis
- `report`: Writes the result of a diagnosis of bench tables
- `rows`: Converts bench tables to pieces, a section for each kind of table
- `search`: Finds the probable models of bench tables
- `table_series`: Defines one measured column of a bench table with the machine model's prediction
- `verdict`: Decides the verdict on bench tables from the probabilities of the models
"""

from topdress.control.calibration.bench_table import BenchTable as Table

from .diagnose import diagnose_tables

__all__ = ["Table", "diagnose_tables"]

"""Diagnoses bench tables: lag, catch, weigh, heads, place. Small numbers of rows allow exact
statistics.

Files:

- `candidate_effects`: Lists the components of a model of bench tables
- `coarse_clock`: Detects times that are quantised by a detector with a coarse clock
- `cross_calibration`: Compares two tables, or two labels of a table
- `diagnose`: Diagnoses bench tables: shows errors, names their causes, lists alternatives
- `duplicate_rows`: Removes measurements that a second table repeats
- `held_out_gain`: Measures the held-out gain of the named causes
- `problem`: Joins all pieces of a diagnosis
- `report`: Writes the result of a diagnosis of bench tables
- `search`: Finds the probable models of bench tables
- `table_noise`: Estimates the noise of one measured column
- `table_rows`: Converts bench tables to pieces, a section for each kind of table
- `table_series`: Defines one measured column of a bench table with the machine model's prediction
- `verdict`: Decides the verdict on bench tables from the probabilities of the models
"""

from topdress.control.calibration.bench_table import BenchTable as Table

from .diagnose import diagnose_tables

__all__ = ["Table", "diagnose_tables"]

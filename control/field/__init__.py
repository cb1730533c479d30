"""Defines the field, the covered ground and the totals of a job, in metres on the field's tangent
plane.

Files:

- `boundary`: Defines the field's edge
- `cell_tests`: Defines the tests of a cell of the bitmap
- `compiled_cells`: Compiled loops over the bitmap's cells, for long simulated runs
- `coverage`: Records the covered ground in a bitmap under the outlets
- `done_ground`: Rasterises ground that another machine or program has covered
- `ground_trace`: Traces the outlets over the ground, also without a known position
- `job`: Defines the job file: the work, its field and strategy
- `job_names`: Names of a job for screens and sheets
- `job_totals`: Sums a job: area, product, nitrogen
- `planned_speed`: Finds the speed that the job plans for the machine's present pass
- `width_error`: Estimates the error of a single rate across the width
"""

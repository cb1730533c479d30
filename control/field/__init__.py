"""Where is the field, which ground is done, and what do the totals amount to? Metres on the
field's tangent plane.

Files:

- `across`: What one rate across the width costs
- `boundary`: Where the field is: inside or not
- `cells`: What is asked of a cell of the bitmap
- `compiled_cells`: The bitmap's cells one by one, compiled
- `coverage`: What of the field is done
- `done_ground`: Ground that another machine or program has covered
- `ground_trace`: The outlets' trace over the ground, also where no place is known
- `job`: A job: what is to be done where, by which strategy; and, for the simulated machine
- `job_names`: Whose job it is, where, of what, by whom
- `planned_speed`: The speed that the job plans for the pass the machine is on
- `totals`: What a job amounts to so far
"""

"""The loop and the machine model closed on an injected clock: tractor, canopy, plant, and what
came to lie where.

Files:

- `assembly`: Machine, crop and job to a control loop and, where the machine is simulated
- `canopy`: A seeded NDVI field with a chosen mean, CV and correlation length (decision paper
- `closed_loop`: A whole run: loop and plant closed on an injected clock, the operator included
- `compiled_steps`: The compiled steps for a long run
- `dose_watch`: Where doses came to lie against the plants they were for
- `error_metrics`: Rate error and place error of a run, as defined once for everybody
- `figures`: What strategies are compared by along with rate and place error
- `noise`: Seeded sensor noise, drawn in blocks because single draws are slow
- `on_hopper`: What else than its load the hopper's scale carries, and what is filled in
- `plant`: The machine in its field, as the model has it
- `plant_rows`: Plants of the simulated field, and where along the machine's way they stand
- `point_run`: A row of plants driven over in point mode
- `rest`: Drives that rest: the later model steps of a tick give what its first one gave
- `tractor`: The tractor: passes up and down a field with half-circle turns, and how fast it goes
- `valves`: The valves of a simulated machine
- `vision`: A simulated camera over a row of plants
"""

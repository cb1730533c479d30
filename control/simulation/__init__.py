"""Simulates the control loop with the machine model on an injected clock: tractor, canopy, plant,
and landed material.

Files:

- `assembly`: How are machine, crop and job assembled to a control loop and a simulated plant?
- `closed_loop`: How does a whole run go?
- `compiled_steps`: Which compiled steps does a long run use?
- `dose_watch`: Where did doses land against their plants?
- `error_metrics`: How large are rate error and place error of a run?
- `hopper_disturbance`: What does the hopper's scale carry besides its load, and what is filled in?
- `plant`: How does the modelled machine behave in its field?
- `plant_rows`: Where do the plants of the simulated field stand along the machine's way?
- `point_run`: How accurate is point mode over a row of plants
- `sensor_noise`: How is seeded sensor noise drawn?
- `simulated_camera`: Which plants does a simulated camera report?
- `simulated_canopy`: Which NDVI does the simulated canopy have?
- `simulated_valves`: How do the valves of a simulated machine share the metered material?
- `skip_resting_steps`: Which model steps need not be computed?
- `strategy_figures`: How do strategies differ besides rate and place error?
- `tractor`: Where does the tractor drive, and how fast?
"""

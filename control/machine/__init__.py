"""How does the machine behave? The one machine model: stages, effects, terms, landing, the
papers' lag models.

Files:

- `change_lag`: The lag of a change of set-points
- `compiled`: The steps compiled over whole logs
- `compiled_tick`: Shaft, gate and flow of a control tick in compiled steps, for long simulated runs
- `effect`: What a stage parameter needs to be an effect
- `effort`: How hard the drives work to do what they do
- `elements`: The few pieces with memory or shape that stages share
- `fall`: From the roller to the ground
- `fault_injection`: Effects that a simulated machine has and its controller does not know
- `flow`: Flow of all outlets together, kg/s, from true shaft speed and opening
- `form`: What a form of a term is
- `forms`: The forms that a term may have, a class each
- `gate`: Metering opening: command mm -> true mm and displacement reading
- `heads`: Canopy heads: true NDVI under each head -> its reading, before noise
- `history`: What a machine file was changed by, and the last of it taken back
- `jit_cache`: Compiled code kept on disk
- `landing`: Where released material comes to lie
- `machine`: One machine: its stages, measures, limits, noise and tolerances
- `parameter_uncertainty`: Machines that a machine file may stand for
- `product_calibration`: A machine as it meters a product
- `scale`: Hopper scale: true kg -> reading
- `sections`: Sections: outlets side by side that are opened and closed together
- `shaft`: Metering shaft: command r/min -> r/min
- `speed`: Ground speed: true m/s -> wheel and GNSS readings, before noise
- `stage_runner`: A stage over a whole log
- `start`: A start as the lag rig measures it
- `steps`: Compiled steps in place of interpreted ones, as whoever begins a long run hands them in
- `term_step`: The evaluator of terms: one value of one term
- `term_sums`: What a machine's terms come to together, quantity by quantity
- `terms`: Terms: what a machine does beyond the catalogue, as data in its file
"""

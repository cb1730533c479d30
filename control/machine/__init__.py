"""Models the machine: stages, effects, terms, landing, and the lag models of the papers.

Files:

- `change_lag`: How long does a change of set-points take from the command until half of the landed
- `compiled`: How do the model's steps run compiled over whole logs?
- `compiled_tick`: How do shaft, gate and flow of a control tick run compiled, for long simulations?
- `effect`: What makes a stage parameter an effect, and which effects does the catalogue contain?
- `effort`: How hard do shaft and gate drives work, from speed, acceleration, material and supply?
- `fall`: How long does material fall from the roller to the ground?
- `fault_injection`: Which effects does a simulated machine have that its controller does not know?
- `flow`: How much material flows from all outlets together, kg/s
- `gate`: How does the metering gate follow its command?
- `heads`: What does a canopy head read from the true NDVI below, before noise?
- `history`: Which changes did a machine file have, and how is the last one undone?
- `jit_cache`: How is compiled code cached on disk?
- `landing`: Where does released material land?
- `machine`: What does a machine file contain?
- `model_elements`: Which small elements with memory or a curve do the stages share?
- `parameter_uncertainty`: Which real machines may a machine file represent?
- `product_calibration`: How does a machine meter a product?
- `scale`: What does the hopper scale read from the true mass?
- `sections`: Which outlets open and close together?
- `shaft`: How does the metering shaft follow its command?
- `speed`: What do wheel and GNSS read from the true ground speed, before noise?
- `stage_runner`: How does a stage run over a whole log?
- `start_lag`: How long does a start take as the lag rig measures it?
- `steps`: Which compiled steps replace interpreted ones in a long run?
- `term_form`: What must a form of a term define?
- `term_forms`: Which forms may a term have?
- `term_step`: What is the value of a term, from its variables and its memory?
- `term_sums`: What do a machine's terms add up to, quantity by quantity
- `terms`: What does a machine do beyond the catalogue?
"""

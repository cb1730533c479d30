"""How does the machine behave? The one machine model: stages, effects, terms, landing, the
papers' lag models.

Files:

- `change_lag`: How long does a change of set-points take from the command until the landed step is
- `compiled`: How do the model's steps run compiled over whole logs?
- `compiled_tick`: How do shaft, gate and flow of a control tick run compiled, for long simulations?
- `effect`: What makes a stage parameter an effect, and which effects does the catalogue contain?
- `effort`: How hard do shaft and gate drives work?
- `elements`: Which small elements with memory or shape do the stages share?
- `fall`: How long does material fall from the roller to the ground?
- `fault_injection`: Which effects has a simulated machine that its controller does not know?
- `flow`: How much flows from all outlets together, kg/s, at a true shaft speed and opening?
- `form`: What must a form of a term define?
- `forms`: Which forms may a term have?
- `gate`: How does the metering gate follow its command?
- `heads`: What does a canopy head read from the true NDVI under it, before noise?
- `history`: Which changes has a machine file had, and how is the last one undone?
- `jit_cache`: How is compiled code kept on disk?
- `landing`: Where does released material land?
- `machine`: What does a machine file contain?
- `parameter_uncertainty`: Which machines may a machine file stand for?
- `product_calibration`: How does a machine meter a product?
- `scale`: What does the hopper scale read from the true mass?
- `sections`: Which outlets open and close together?
- `shaft`: How does the metering shaft follow its command?
- `speed`: What do wheel and GNSS read from the true ground speed, before noise?
- `stage_runner`: How does a stage run over a whole log?
- `start`: How long does a start take as the lag rig measures it?
- `steps`: Which compiled steps replace interpreted ones in a long run?
- `term_step`: What is the value of a term, from its variables and its memory?
- `term_sums`: What do a machine's terms add up to, quantity by quantity?
- `terms`: What does a machine do beyond the catalogue?
"""

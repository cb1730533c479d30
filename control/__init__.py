"""What is decided and what is modelled? Pure functions and values: no I/O, no clock, no thread,
no screen.

Files:

- `agronomy`: How much product does this canopy need?
- `calibration`: Which machine parameters follow from tests?
- `diagnosis`: Finds the errors of the machine model on measured data, their causes
- `experiments`: What should be measured next?
- `field`: Where is the field, which ground is done, and what do the totals amount to?
- `frozen_model`: How is the checked content of a file held?
- `geodesy`: How are degrees converted to metres on WGS84
- `log_row`: Which columns does a run log have?
- `loop`: Runs one tick of control
- `machine`: Models the machine: stages, effects, terms, landing, and the lag models of the papers
- `metering`: Which shaft speed and opening give a wanted flow?
- `orders`: Which words do operator, loop and log share?
- `papers`: Compares the numbers printed in the three papers with the results of this program's
- `readings`: What did the machine's sensors read, and what is sent to its drives?
- `recordings`: What is wrong with recorded data, and how is it repaired safely?
- `safety`: May material flow? States, interlocks, alarms, and the last gate before the drives
- `sensing`: Which speed and which place does control use
- `simulation`: How does the control loop work on the machine model?
- `targets`: Which target holds where?
"""

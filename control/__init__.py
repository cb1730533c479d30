"""What is decided and what is modelled? Pure functions and values: no I/O, no clock, no thread,
no screen.

Files:

- `agronomy`: Determines the product that a canopy needs
- `calibration`: Determines machine parameters from tests
- `diagnosis`: Finds the errors of the machine model on measured data, their causes
- `experiments`: Plans the next measurement
- `field`: Defines the field, the covered ground and the totals of a job
- `frozen_model`: How is the checked content of a file held?
- `geodesy`: How are degrees converted to metres on WGS84
- `log_row`: Which columns does a run log have?
- `loop`: Runs one tick of control
- `machine`: Models the machine: stages, effects, terms, landing, and the lag models of the papers
- `metering`: Finds shaft speed and opening for a wanted flow
- `orders`: Which words do operator, loop and log share?
- `papers`: Compares the numbers printed in the three papers with the results of this program's
- `readings`: What did the machine's sensors read, and what is sent to its drives?
- `recordings`: Finds errors in recorded data and repairs them safely, for readers of every kind
- `safety`: Decides whether material may flow
- `sensing`: Determines the speed and position that control uses
- `signals`: Which numbers does a machine sense, command or log?
- `simulation`: Simulates the control loop with the machine model on an injected clock
- `targets`: Finds the target of each position
"""

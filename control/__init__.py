"""What is decided and modelled. Pure: no I/O, no clock, no thread, no screen.

Files:

- `agronomy`: From canopy to rate: crops, the nitrogen optimisation, day counts, sampling statistics
- `calibration`: Tests to machine parameters
- `diagnosis`: What the machine model gets wrong on measured data, why
- `experiments`: What to measure next: design of experiments
- `field`: The field: its edge, what is done of it, and the totals
- `frozen_model`: What a file holds, once checked
- `geodesy`: Degrees to metres and back on WGS84, and the small geometry of driving
- `log_row`: One row of a run log: the public column contract, in its published order
- `loop`: One tick of control: measurements in, commands and a log row out
- `machine`: THE machine model: stages, effects, landing, the papers' lag models
- `metering`: Wanted flow to a pair of shaft speed and opening
- `orders`: The words shared by operator, loop and log
- `papers`: What the three papers print, and the same from this program's models
- `readings`: What the machine's sensors said, and what is sent to its drives
- `recordings`: What is odd about recorded data, put right where that is safe, and always said
- `safety`: Safety: states, interlocks, alarms, and the last gate before the drives
- `sensing`: Which speed and which place control uses
- `simulation`: The loop and the machine model closed on an injected clock
- `targets`: Which target holds where
"""

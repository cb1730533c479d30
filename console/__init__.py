"""What people see: the control worker, the app, reports and the command line.

Files:

- `app`: The console's screens know `console.frame.Frame` and a `FrameSource`
- `attached`: Who is attached to the control worker, and who ordered what?
- `cli`: The command line: `topdress --help`
- `frame`: What the control worker tells its consoles, ten times a second while the machine moves
- `gc_tuning`: What lives as long as the console is not swept again and again
- `import_hooks`: What makes a program come up quickly
- `link`: The console's end of the control worker
- `locale`: Translates the texts of the console into the language in use
- `reports`: What is written for people to read
- `running`: The control worker as a process of its own
- `scale`: Colour scales. For rates: perceptually even, safe for colour-blind eyes
- `serve`: Serves the console to browsers
- `services`: What the pages have done with files and long work
- `threads`: How many threads may numeric libraries take for themselves?
- `warm_up`: Compiles once on a computer what a first diagnosis would compile
- `worker`: The control worker is a program of its own that owns devices, loop and log
- `worker_handshake`: Who listens where a run file says?
"""

import time

from topdress.drivers import day_clock

# libraries ask it while they are loaded (logging), where it raises
if not day_clock.is_clock_set():
    time.time = day_clock.read_epoch_s

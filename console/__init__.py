"""What do people see? This package contains the control worker, the app, reports and the command
line.

Files:

- `app`: The console's screens know `console.frame.Frame` and a `FrameSource`
- `attached_consoles`: Who is attached to the control worker, and who gave which order?
- `cli`: How is the command line `topdress` built?
- `colour_scale`: Which colours do rates, errors and passes have?
- `fast_imports`: How does a program start quickly?
- `frame`: Which data does the control worker send to its consoles?
- `gc_tuning`: How are long-lived objects kept out of the garbage collection?
- `link`: How does a console communicate with the control worker?
- `locale`: Translates the texts of the console into the language in use
- `reports`: Which texts and pictures do people read?
- `running`: How is the control worker started as a process of its own
- `serve`: Serves the console to browsers
- `services`: How are the services of the pages implemented on real files?
- `thread_limits`: How many threads may numeric libraries use?
- `warm_up`: How is the first diagnosis on a computer made fast?
- `worker`: The control worker is a program of its own that owns devices, loop and log
- `worker_handshake`: Which program listens at the address in a run file?
"""

import time

from topdress.drivers import day_clock

# Libraries such as logging read the time while they are loaded. Without a set clock it may raise.
if not day_clock.is_clock_set():
    time.time = day_clock.read_epoch_s

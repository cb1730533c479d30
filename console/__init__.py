"""What people see: the control worker, the app, reports and the command line."""

import time

from topdress.drivers import day_clock

# libraries ask it while they are loaded (logging), where it raises
if not day_clock.is_set():
    time.time = day_clock.epoch_s

"""What people see: the control worker, the app, reports and the command line."""
import time

from drivers import day_clock

if not day_clock.is_set():      # libraries ask it while they are loaded (logging), where it raises
    time.time = day_clock.epoch_s

"""One module a screen.

Files:

- `alarm_list`: All alarms of the run: first, last, how often, acknowledged when, and what to do
- `help`: F1: what every key does, and what the signs mean
- `jump`: Letters over whatever can be clicked; typing them clicks it
- `worker_lost_screen`: The control worker is gone
"""

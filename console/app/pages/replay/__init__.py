"""The Replay page plays a log, as recorded or recomputed with another strategy, crop or machine.

Files:

- `keys`: Defines the keys of the Replay page and their functions
- `page`: Shows the Replay screen: the panels of the Run page, fed from a log
- `service`: Declares the data and functions that the Replay page receives
"""

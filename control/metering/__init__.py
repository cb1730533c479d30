"""Wanted flow to a pair of shaft speed and opening: the inverse of the machine model,
strategies, trims.

Files:

- `flow_trim`: The hopper scale against what shaft and opening should have taken
- `inverse`: The machine model solved for its set-points, effects included
- `rate_range`: The rates that a machine can spread at a speed
- `setting`: A wanted rate to shaft and gate
- `strategies`: Opening first and speed first
- `trims`: The host's slow corrections of shaft and gate to their measured values, bounded
"""

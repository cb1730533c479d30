"""Finds shaft speed and opening for a wanted flow: the inverse of the machine model, strategies,
trims.

Files:

- `flow_trim`: Does the hopper scale confirm the flow that shaft and opening give?
- `inverse_model`: Which set-points give this flow?
- `pair_planner`: Which shaft speed and opening are commanded for a wanted rate in this tick?
- `rate_range`: Which rates can a machine spread at a speed
- `strategies`: Which pair of true shaft speed and opening gives a wanted flow?
- `trims`: How are shaft and gate corrected towards their measured values?
"""

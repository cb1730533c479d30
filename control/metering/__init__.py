"""Finds shaft speed and opening for a wanted flow: the inverse of the machine model, strategies,
trims.

Files:

- `flow_trim`: Does the hopper scale confirm the flow that shaft and opening give?
- `inverse`: Which set-points give this flow?
- `rate_range`: Which rates can a machine spread at a speed
- `setting`: Which shaft speed and opening are commanded for a wanted rate in this tick?
- `strategies`: Which pair of true shaft speed and opening gives a wanted flow?
- `trims`: How are shaft and gate corrected towards their measured values?
"""

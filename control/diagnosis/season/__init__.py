"""Analyses many logs of many machines together: the course of each effect over a season, and common
causes.

Files:

- `change_points`: Finds changes in the course of one effect on one machine
- `effect_timelines`: Reports a season: the course of each effect on each machine
- `log_evidence`: Summarises the information of one log on every effect in a few numbers
- `mixed_model`: Fits one model to a whole season
- `season_cost`: Calculates the cost of a season for the owner
"""

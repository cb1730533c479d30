"""Many logs of many machines together: what each effect did over a season, and what is shared.

Files:

- `changes`: Where the course of one effect on one machine changes
- `effect_timelines`: What a season says: the course of each effect on each machine
- `evidence`: What one log says of every effect, in a few numbers
- `mixed`: One model of a whole season
- `season_cost`: What a season of logs means to the owner
"""

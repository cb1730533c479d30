"""What is odd about recorded data, put right where that is safe, and always said: one home for
readers of every kind.

A log of ours, a log of another program, what a notebook hands over and a bench table are all
mended by the same rules: `times` (units, order, repeats), `values` (what no machine reads,
sentinels, ranges, readings held), `speeds` (units), `places`, and `mended`, which asks them in
their order. A `finding` says what was odd and what was done about it.

Files:

- `finding`: What a reader noticed about a file and did about it, in plain words
- `mended`: A recording's columns put right, each thing in its turn
- `places`: The places of a recording
- `speeds`: The units of speeds, read off the way between places, or off the other speed
- `times`: The times of a recording
- `values`: The values of a recording
"""

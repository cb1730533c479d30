"""What is odd about recorded data, put right where that is safe, and always said: one home for
readers of every kind.

A log of ours, a log of another program, what a notebook hands over and a bench table are all
mended by the same rules: `times` (units, order, repeats), `values` (what no machine reads,
sentinels, ranges, readings held), `speeds` (units), `places`, and `mended`, which asks them in
their order. A `finding` says what was odd and what was done about it.
"""

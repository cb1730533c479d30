"""What is wrong with recorded data, and how is it repaired safely? One home for readers of every
kind.

A log of ours, a log of another program, what a notebook hands over and a bench table are all
mended by the same rules: `times` (units, order, repeats), `values` (what no machine reads,
sentinels, ranges, readings held), `speeds` (units), `places`, and `mended`, which asks them in
their order. A `finding` says what was odd and what was done about it.

Files:

- `finding`: What did a reader notice about a file and do about it?
- `mended`: How are the columns of a recording repaired?
- `places`: Are the places of a recording plausible?
- `speeds`: Which unit does a speed column have?
- `times`: When was each row recorded?
- `values`: Which values of a recording are real readings?
"""

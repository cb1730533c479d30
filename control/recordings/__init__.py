"""Finds errors in recorded data and repairs them safely, for readers of every kind.

A log of topdress, a log of another program, data from a notebook and a bench table are repaired by
the same rules: `times` (units, order, repeats), `values` (unreadable numbers, sentinels, ranges,
repeated readings), `speeds` (units), `places`, and `mended`, which applies them in order. A
`finding` reports each anomaly and its repair.

Files:

- `finding`: What did a reader notice about a file and do about it?
- `mended`: How are the columns of a recording repaired?
- `places`: Are the places of a recording plausible?
- `speeds`: Which unit does a speed column have?
- `times`: When was each row recorded?
- `values`: Which values of a recording are real readings?
"""

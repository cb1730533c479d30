"""Finds errors in recorded data and repairs them safely, for readers of every kind.

A log of topdress, a log of another program, data from a notebook and a bench table are repaired by
the same rules: `row_times` (units, order, repeats), `valid_values` (unreadable numbers, sentinels,
ranges, repeated readings), `speed_unit`, `place_check`, and `column_repair`, which applies them in
order. A `finding` reports each anomaly and its repair.

Files:

- `column_repair`: How are the columns of a recording repaired?
- `finding`: What did a reader notice about a file and do about it?
- `place_check`: Are the places of a recording plausible?
- `row_times`: When was each row recorded?
- `speed_unit`: Which unit does a speed column have?
- `valid_values`: Which values of a recording are real readings?
"""

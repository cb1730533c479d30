"""What the screens are built of. Each shows one frozen view and is drawn again only when that
view changes.

Files:

- `alarm_bar`: The alarms: word, symbol, text, place, first time, what to do
- `canvas`: The base of drawn panels
- `chips`: What can be done now, as keys with words over one or more rows
- `choice_list`: One list for all questions
- `field_map`: A map that is alive. Only rows that changed are drawn again
- `items`: Labels and values: one column where there is room, else two to a row
- `key_bar`: The bottom row: keys and what they do, clickable; for some seconds
- `map_legend`: One row under a map: what its colours mean, and how long a stretch of it is
- `panel`: The base of all panels: one frozen view in, rows out
- `rates`: Target and applied rate, the largest things on the screen
- `status_line`: The top row: state, strategy, source of the target, marks, time
- `tiles`: Speed, shaft, opening, hopper
- `trend`: Target and applied rate over the last two minutes, in braille
"""

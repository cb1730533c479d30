"""Widgets of the screens; each shows one frozen view and is drawn again only when the view
changes.

Files:

- `alarm_bar`: Shows the alarms: word, symbol, text, place, first time, remedy
- `canvas`: Defines the base class of drawn panels
- `chips`: Shows possible actions as keys with words over one or more rows
- `choice_list`: Draws the list of all questions
- `field_map`: Shows a map that changes continuously; only changed rows are drawn again
- `items`: Shows labels and values: in one column where there is room, else two per row
- `key_bar`: Shows the bottom row: clickable keys with their words; for some seconds
- `map_legend`: Shows the meaning of a map's colours and a scale bar in one row
- `panel`: Defines the base class of all panels
- `rates`: Shows target and applied rate, the largest numbers on the screen
- `status_line`: Shows the top row: state, strategy, source of the target, marks, time
- `tiles`: Shows speed, shaft, opening and hopper
- `trend`: Plots target and applied rate over the last two minutes in braille, 2 x 4 dots per cell
"""

"""Widgets of the screens; each shows one frozen view and is drawn again only when the view
changes.

Files:

- `action_chips`: Shows possible actions as keys with words over one or more rows
- `alarm_bar`: Shows the alarms: word, symbol, text, place, first time, remedy
- `base_panel`: Defines the base class of all panels
- `canvas`: Defines the base class of drawn panels
- `choice_list`: Draws the list of all questions
- `field_map`: Shows a map that changes continuously; only changed rows are drawn again
- `key_bar`: Shows the bottom row: clickable keys with their words; for some seconds
- `labelled_values`: Shows labels and values: in one column where there is room, else two per row
- `map_legend`: Shows the meaning of a map's colours and a scale bar in one row
- `rate_panels`: Shows target and applied rate, the largest numbers on the screen
- `rate_trend`: Plots target and applied rate over the last two minutes in braille
- `status_line`: Shows the top row: state, strategy, source of the target, marks, time
- `value_tiles`: Shows speed, shaft, opening and hopper
"""

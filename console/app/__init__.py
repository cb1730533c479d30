"""The console's screens know `console.frame.Frame` and a `FrameSource`, and no device and no
file.

Files:

- `action`: Declares one action of the console
- `actions`: Lists every action once; bindings, key bar, help and palette are made from this table
- `alarms`: Decides when the terminal's bell rings and words the list of the run's alarms
- `app`: Defines the Textual app, which supervises the source of frames
- `attach_notice`: Words the notice of a console that joins a running machine
- `block_digits`: Draws numerals from blocks, with one face of 3 x 5 pixels at three scales
- `boundary_drive`: Records a field's boundary while the machine drives round the field
- `braille`: Draws lines in braille characters (2 x 4 dots a cell) from values over time
- `common_keys`: Defines the actions that every page offers, with their functions
- `coverage_raster`: Accumulates applied rate, target
- `dialogs`: Defines the dialogs that ask before something changes
- `dose_change_check`: Predicts how orders change the dose
- `field_picture`: Defines the static parts of a map
- `first_question`: Asks at the start for field and job, most recent first
- `frame_history`: Stores the history that plots and map show
- `frame_source`: Declares the source of frames and the receiver of orders
- `frame_words`: Translates the ids in frames to words
- `guide_line`: Calculates how far the machine is off the nearest parallel of a guidance line from
- `guide_line_store`: Converts the A-B line and a boundary in progress to records of a file next to
- `guided_tour`: Defines the guided tour: eight steps on the simulated machine
- `held_key`: Decides whether a key or mouse button is held down
- `impossible_reasons`: Explains in one line why an action is impossible now
- `key_normaliser`: Determines which key an operator meant
- `map_camera`: Defines the part of the ground that a map shows
- `map_image`: Calculates the palette entry of every map pixel
- `map_ink`: Draws every map: pages
- `map_layers`: Defines the quantities that colour a map, and the range of each colour scale
- `name_dialog`: Defines the dialog that asks for a line of text, such as a file name or path
- `number_dialog`: Defines the only field of the console that accepts a number
- `order_words`: Words an order, either as given or as offered
- `overlay_file`: Holds a file of another day that is overlaid on the map below the work
- `pages`: Each page has a folder with its screen, its keys and their functions, its words
- `panel_views`: Converts a frame and its age to the texts and shares that panels show
- `picture_cache`: Caches pictures of fields
- `plain_lines`: Removes terminal control characters from every line before it is drawn
- `presence_text`: Words the presence of other consoles at the machine
- `refresh_rates`: Decides how often each kind of panel is refreshed
- `remaining_work`: Estimates the remaining area, product
- `replay_source`: Plays the frames of a log on a clock of its own
- `screens`: Screens that cover a page
- `services`: Declares the files and long work that screens need
- `settings`: Checks the user's settings for the console and applies them
- `tablet_app`: Runs the console in a browser tab
- `terminal`: Determines the colours that the terminal can show
- `terminal_watch`: Ends a console with its terminal
- `themes`: Defines the themes day, night and high contrast, with colours for target, applied
- `trend_channels`: Which channels can the Trends page plot?
- `trend_series`: Calculates lowest, highest and mean values of a channel over time spans
- `type_ahead_guard`: Swallows keys that were typed for a question that was refused
- `typed_number`: Reads a number that an operator types
- `undo_stack`: Records changes that can be undone, with one key and one question
- `units`: Converts SI values to displayed units
- `widgets`: Widgets of the screens
"""

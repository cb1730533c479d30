"""The console's screens. They know `console.frame.Frame` and a `FrameSource`, nothing of
devices or files.

Files:

- `action`: One action: its key, its words, what it does, and the screen that it belongs to
- `actions`: Every action once. Bindings, key bar, help and palette are read off this table
- `alarms`: Alarms on the console: when the bell rings, and what the list of the run's alarms says
- `app`: The Textual app: it supervises the source of frames, turns keys into orders
- `attach_notice`: A console that joins a machine which runs already says so
- `boundary_drive`: A field's boundary by driving round it
- `braille`: Lines in braille, 2 x 4 dots a cell
- `camera`: Where a map looks: its middle and how many metres a pixel is
- `channels`: Every number of a log row as a channel that can be plotted
- `coverage_raster`: What was done where: a raster of the worked ground
- `dialogs`: What is asked before a dose changes
- `digits`: Numerals drawn from blocks
- `dose_change`: What orders make of the dose
- `field_picture`: What does not move on a map
- `fields`: The pictures of fields, loaded once each along with the screens; until then
- `first_question`: Which field and job, asked at the start
- `guide_line`: A guidance line from A to B: how far the machine is off the nearest of its parallels
- `guide_line_store`: The A-B line and a boundary that is being driven
- `held_key`: A key or a mouse button that must stay down while the shaft turns
- `history`: What the plots and the map remember, bounded in memory however long the day is
- `key_normaliser`: Which key is meant by one that was pressed
- `keys`: Keys of every page and what they do
- `layers`: What a map can be coloured by, and from where to where its colours go
- `map_image`: The map as numbers: which palette entry every pixel has
- `map_ink`: One drawing for every map
- `name_dialog`: A line of text is asked for
- `number_dialog`: A number is asked for: the one field of this console that takes one, by keys
- `ordered_words`: An order in words, as it was given or as it is offered
- `overlay_file`: A file of another day, laid on the map under the work
- `pages`: A folder for each page: its screen, its keys with what they do, its words
- `plain_lines`: The last gate before the screen
- `presence_text`: Others at the same machine, in words
- `reasons`: Why something cannot be done now, in one line; empty where it can
- `refresh_rates`: How often each kind of panel is looked at
- `remaining_work`: What a job still takes: area, product, way and time
- `replay_source`: A log's frames on a clock of their own
- `screens`: One module a screen
- `series`: Lowest, highest and mean of a channel over spans of time
- `services`: What screens can have done that needs files or long work
- `settings`: The user's settings on the console
- `source`: Where frames come from and orders go to
- `tablet`: The console in a browser's tab
- `terminal`: What the terminal at hand can show, and whether it still does
- `terminal_watch`: A console ends with its terminal
- `themes`: Day, night and high contrast
- `tour`: The guided tour: eight steps on the simulated machine, each done by doing it
- `type_ahead_guard`: What is typed for a question that was never asked goes nowhere
- `typed_number`: A number as an operator types it
- `undo`: What was changed last and can be taken back
- `units`: The one place where SI becomes what people read
- `view`: What the panels show, as frozen values
- `widgets`: What the screens are built of
- `words`: Words for what frames carry as ids
"""

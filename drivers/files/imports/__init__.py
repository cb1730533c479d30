"""How do logs of any machine become topdress run logs: what does a file hold, what do its
columns mean, and how are they converted?

Files:

- `convert`: A raw table and what its columns mean
- `devices`: What a number of an ISO 11783-10 time log is
- `dialect`: How a text file is written
- `excel`: Excel workbooks (.xlsx, .xlsm, .xls, .xlsb, .ods)
- `guess`: A first import file by looking at a table
- `guess_columns`: Which column of a file is which of the log
- `guess_time`: Which column tells the time, and how
- `guessed`: What a guess holds: the import file, what of it is unsure, and why the rest is as it is
- `header`: Where a table begins: title rows, the header, a row of units, the first row of numbers
- `join`: Files of one machine as one log
- `log_file`: Imported columns as a run log with its sidecar (docs/format-run-log.md)
- `mapping`: Import file "topdress-import/1": what the columns of a foreign log mean
- `numbers`: Cells of a foreign table as numbers
- `physics`: What the numbers themselves say
- `points`: Points with attributes: GeoJSON and shapefiles, as many as-applied files are
- `raw`: A table as a file holds it, before anything is said of its meaning
- `read`: A file of any kind as a raw table
- `task_log`: The time logs of an ISO 11783-10 task set as one table
- `text`: The one reader of text tables (CSV and its relatives)
- `time_format`: Times written after a format as `strptime` has them, many at once
- `time_logs`: ISO 11783-10 time logs (TLG)
- `times`: The times of a foreign table
- `trouble`: What goes wrong with a table or a log, in plain lines
- `units`: Units as machines write them, and what one of each is in the unit of a log column
- `words`: What people call the columns of a machine's log and of a map, in English, German, Chinese
"""

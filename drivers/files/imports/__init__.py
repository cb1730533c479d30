"""How do logs of any machine become topdress run logs: what does a file hold, what do its
columns mean, and how are they converted?

Files:

- `convert`: How do a raw table and the meaning of its columns become the columns of a run log?
- `devices`: What does a number of an ISO 11783-10 time log mean, by the data dictionary
- `dialect`: How is a text file written
- `excel`: How is an Excel workbook (.xlsx, .xlsm, .xls, .xlsb, .ods) read
- `guess`: Which import file fits a table, by names, units, ranges and physics
- `guess_columns`: Which column of a file is which column of the log, by names, units and ranges?
- `guess_time`: Which column holds the time, and in which form, by name, by unit
- `guessed`: What does a guess hold: the import file, what about it is unsure
- `header`: Where does a table begin
- `import_errors`: Which errors may a table or a log have, in plain lines?
- `join`: How do files of a machine become a single log
- `log_file`: How are imported columns written as a run log with its sidecar
- `mapping`: What does an import file "topdress-import/1" say about the columns of a foreign log?
- `numbers`: Which numbers do the cells of a foreign table hold, with decimal commas, thousands
- `physics`: What do the numbers themselves show
- `points`: How are points with attributes read as a table
- `raw`: What does a table hold as its file has it, before its meaning is known?
- `read`: How is a file of any kind read as a raw table?
- `task_log`: How do the time logs of an ISO 11783-10 task set become a single table
- `text`: How are text tables (CSV and its relatives) read
- `time_format`: How are many times in a format, as `strptime` has it, read at once?
- `time_logs`: How are ISO 11783-10 time logs (TLG) read
- `times`: How are the times of a foreign table read as whole microseconds
- `units`: Which units do machines write, and what is one of each in the unit of a log column?
- `words`: Which words do people use for the columns of a machine's log and of a map, in English
"""

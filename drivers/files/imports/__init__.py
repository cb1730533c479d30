"""How do logs of any machine become topdress run logs? A file is read, the meaning of its columns
found, and its numbers converted.

Files:

- `cell_numbers`: Which numbers do the cells of a foreign table hold?
- `column_vocabulary`: Which words do people use for the columns of a machine's log and of a map?
- `convert`: How do a raw table and the meaning of its columns become the columns of a run log?
- `device_description`: What does a number of an ISO 11783-10 time log mean?
- `dialect`: How is a text file written?
- `excel`: How is an Excel workbook (.xlsx, .xlsm, .xls, .xlsb, .ods) read?
- `guess`: Which import file fits a table?
- `guess_columns`: Which column of a file corresponds to which column of the log?
- `guess_result`: What does a guess contain?
- `guess_time`: Which column holds the time, and in which format?
- `import_errors`: Which errors can a table or a log have?
- `log_file`: How are imported columns written as a run log with its sidecar
- `log_join`: How do files of a machine become a single log?
- `mapping`: How does an import file "topdress-import/1" describe the columns of a foreign log?
- `physical_checks`: What do the numbers themselves reveal?
- `point_tables`: How are points with attributes read as a table?
- `raw_table`: What content does a table have before its meaning is known?
- `table_header`: Where does a table begin, and how is a column's name separated from its unit?
- `table_reader`: How is a file of any kind read as a raw table?
- `task_log`: How do the time logs of an ISO 11783-10 task set become a single table?
- `text_table`: How are text tables (CSV and its relatives) read?
- `time_cells`: How are the times of a foreign table read as whole microseconds?
- `time_format`: How are many times in a format of `strptime` read at once?
- `time_logs`: How are ISO 11783-10 time logs (TLG) read?
- `units`: Which units do machines write
"""

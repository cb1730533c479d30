"""Which files does topdress read and write? They are configuration, run logs, replay, and tables of
other programs.

Files:

- `any_log`: How is a log of any program opened as a run log?
- `archives`: Which files does a folder or a zip contain?
- `atomic_files`: How are files written completely or not at all?
- `bench_table`: How are bench tables (CSV) read
- `calibration_log`: Which columns does a calibration need from a run log?
- `columns`: How are tables stored in memory?
- `config`: How is a configuration file read?
- `config_error`: Which errors does a configuration file have?
- `config_kinds`: Which kinds of configuration files does topdress know?
- `config_words`: How do pydantic's errors appear in an operator's words?
- `exports`: How is a run log exported as applied work
- `farm_lines`: Which lines does a farm record contain, as `topdress record` writes it
- `fields`: How are fields of other programs read and written?
- `file_content`: Which content does a file have
- `file_sniffer`: Which kind of file is a file, by its first bytes and its name
- `foreign_logs`: How are foreign logs corrected, whose names
- `formats`: Which formats of files does topdress read and write?
- `geopackage`: How is a GeoPackage (OGC 12-128r19) read by SQLite?
- `growing_log`: Which rows have been added since the last reading to a log that another program is
- `header_names`: Which topdress columns does a header name?
- `imports`: How do logs of any machine become topdress run logs?
- `kml`: How are KML (OGC 12-007r2) and KMZ read?
- `lenient_line_reader`: Which lines of a log can be read
- `limits`: How much of a file is read?
- `log_store`: How is a run log stored as Parquet?
- `log_text`: How is a log row written as a line of text?
- `ogr`: How are shapes with attributes written to formats of GDAL (KML, KMZ, GeoPackage)?
- `optional_packages`: Which optional parts of topdress (extras of pyproject.toml) are installed
- `outline_overlaps`: How often do a map's outlines overlap or cross?
- `parquet_limits`: How much content does a Parquet file have?
- `plain_data`: How do models become plain data and JSON schema, and how are they read back?
- `prescriptions`: How are prescription files read and written
- `process_lock`: How does a single process hold a lock?
- `read_log`: How are run logs read? Topdress's own logs are read up to their last whole row
- `replay`: Which measurements did the control loop receive, and which commands did it give
- `run_log`: How are run logs (docs/format-run-log.md) written?
- `run_meta`: With which software, machine, crop, job and files was a run made?
- `run_setup`: Which configuration does a run need?
- `settings`: Which settings of the console does a user choose?
- `shape_layers`: How are shapes with attributes read from GeoJSON, shapefiles, GeoPackage
- `shape_sets`: Which files form a shapefile?
- `sheet_text`: What content do a workbook's sheets have
- `stated_units`: Which units does a file state outside of a column's name and cells?
- `table`: How are tables of any origin read as columns by name?
- `trial_plots`: Which plots does a trial have, and which amounts were applied, read
- `user_themes`: Which theme has a user made?
- `weather`: How is daily weather read from a CSV file
- `xml_text`: How does topdress read XML?
- `yaml_text`: How does topdress read and write YAML?
"""

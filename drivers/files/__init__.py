"""Which files does topdress read and write: configuration, run logs, replay, tables of other
programs?

Files:

- `any_log`: How is a log of any program opened as a run log
- `archives`: Which files does a folder or a zip hold, by their names
- `atomic`: How are files written so that they are either whole or not there?
- `bench_table`: How are bench tables (CSV) read
- `calibration_log`: What do the calibrations from a run log read from it?
- `columns`: How are tables held in memory?
- `config`: How is a configuration file read
- `config_error`: What is wrong with a configuration file?
- `config_words`: How do pydantic's errors read in an operator's words
- `exports`: How is a run log exported as what was applied where
- `extras`: Which parts of topdress are installed on their own (extras of pyproject.toml)
- `farm_lines`: Which lines does a farm's book hold, as `topdress record` keeps it
- `fields`: How are fields of other programs read and written
- `file_sniffer`: Which kind of file is a file, by its first bytes and its name
- `foreign`: How are logs of other programs corrected, whose names
- `geopackage`: How is a GeoPackage (OGC 12-128r19) read by SQLite
- `growing_log`: What has been added since the last reading to a log that another program is still
- `header_names`: Which of this program's columns does a header name, in any letter case
- `imports`: How do logs of any machine become topdress run logs
- `kinds`: Which kinds of configuration files does topdress know?
- `kml`: How are KML (OGC 12-007r2) and KMZ read
- `layers`: How are shapes with attributes read from GeoJSON, shapefiles, GeoPackage, KML and KMZ
- `lenient_line_reader`: Which lines of a log can be read
- `limits`: How much is read of any file?
- `lock`: How does a single process hold a lock that the system returns when the process ends
- `log_store`: How is a run log kept as Parquet
- `log_text`: How is a log row written as a line of text
- `ogr`: How are shapes with attributes written to formats of GDAL (KML, KMZ, GeoPackage)
- `opened`: What does a file hold: a log, a bench table, a map or a field? Every command asks here
- `outlines`: How much do a map's outlines overlap or cross, counted before they are repaired
- `parquet_limits`: How much does a Parquet file hold, by its footer and the headers of its pages
- `plain`: How do models become plain data, JSON schema, and back?
- `prescriptions`: How are prescription files read and written
- `read_log`: How are run logs read: our own up to their last whole row
- `replay`: What was the control loop given, and what did it order, by its log?
- `run_log`: How are run logs (docs/format-run-log.md) written
- `run_meta`: What does NAME.yaml next to a run log say
- `settings`: What does a user want of the console?
- `settings_theme`: Which theme has a user made
- `setup`: What does a run need from its configuration files
- `shape_sets`: Which files make a shapefile, wherever they lie
- `sheet_text`: What do the cells of a workbook's sheets hold
- `stated_units`: Which units does a file state elsewhere than in a column's name or its cells
- `table`: How are tables of any origin (CSV and its relatives
- `trial`: Which plots does a trial have, what did a log do and read in each
- `weather`: How is daily weather read from a CSV file
- `xml_text`: How does topdress read XML: elements and their texts, no entities
- `yaml_text`: How does topdress read and write YAML: YAML 1.2 scalars, no duplicate keys, no bombs
"""

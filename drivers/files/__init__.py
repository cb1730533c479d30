"""Which files does topdress read and write: configuration, run logs, replay, tables of other
programs?

Files:

- `any_log`: A log of any program, opened as a run log
- `archives`: The files of a folder or a zip, by their names
- `atomic`: Files that are either whole or not there
- `bench_table`: Bench tables (CSV): lag, catch, weigh, heads, place
- `calibration_log`: What the calibrations from a run log read of it
- `columns`: Tables in memory: columns by name, each a numpy array of the same length
- `config`: Configuration files: YAML into a pydantic model
- `config_error`: What is wrong with configuration files, apart from what reads them
- `config_words`: pydantic's errors in the words of an operator
- `exports`: How is a run log exported as what was applied where
- `extras`: The parts of topdress that are installed by themselves (extras of pyproject.toml)
- `farm_lines`: Lines of a farm's books, as `topdress record` keeps them
- `fields`: How are fields of other programs read and written
- `file_sniffer`: What kind of file a file is, by its first bytes and its name
- `foreign`: Logs of other programs: names
- `geopackage`: GeoPackage (OGC 12-128r19) by SQLite
- `growing_log`: A log that another program is still writing
- `header_names`: A header's names as this program has them
- `imports`: How do logs of any machine become topdress run logs
- `kinds`: The kinds of configuration files that topdress knows
- `kml`: KML (OGC 12-007r2) and KMZ: placemarks with polygons, lines and attributes
- `layers`: Shapes with attributes out of GeoJSON, shapefiles, GeoPackage, KML and KMZ
- `lenient_line_reader`: Of lines that are not all readable those that are
- `limits`: How much is read of any file
- `lock`: A lock that one process holds
- `log_store`: A run log as Parquet: one file that holds the columns
- `log_text`: A log row as one line of text
- `ogr`: Shapes with attributes to formats that GDAL writes (KML, KMZ, GeoPackage), through pyogrio
- `opened`: What a file holds, asked in one place by every door
- `outlines`: How much of a map's outlines lies over itself, counted before it is put right
- `parquet_limits`: How much a Parquet file holds, by its footer and the headers of its pages
- `plain`: Models as plain data and back, and as JSON schema; NamedTuples by name (pydantic alone
- `prescriptions`: How are prescription files read and written
- `read_log`: Reading run logs: our own up to their last whole row
- `replay`: A log turned back into what the control loop was given and what it ordered
- `run_log`: Writing run logs (docs/format-run-log.md)
- `run_meta`: What stands next to a run log in NAME.yaml
- `settings`: The console's settings: what one user wants, in one file
- `settings_theme`: A theme of the user's own
- `setup`: What a run needs of its configuration files
- `shape_sets`: The files that make a shapefile, wherever they lie
- `sheet_text`: Workbooks: the cells of their sheets
- `stated_units`: Units that a file states elsewhere than in a column's name or its cells
- `table`: Tables of any origin (CSV and its relatives
- `trial`: Plots of a trial, what a log did and read in each
- `weather`: Daily weather from a CSV file, and a crop's growing days counted from it
- `xml_text`: XML as topdress reads it
- `yaml_text`: YAML as topdress reads and writes it
"""

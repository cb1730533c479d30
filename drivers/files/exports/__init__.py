"""How is a run log exported as applied work: GeoJSON, shapefile, ISO 11783-10 task with time log,
CSV? `write_as_applied` chooses the format.

Files:

- `as_applied`: Which rate was applied at which place?
- `export_columns`: Which columns do the flat exports (CSV, GeoJSON, shapefile) have?
- `export_writer`: How is an as-applied export written in the format of the path's suffix?
- `farm_record`: Which passes does a farm record contain, one CSV line each
- `isoxml`: How is applied work written as an ISO 11783-10 task?
- `released_while_stopped`: How much material did a machine release while it was commanded to stop?
- `time_log`: How is an ISO 11783-10 time log (TLG) written?
"""

"""How is a run log exported as what was applied where: GeoJSON, shapefile, ISO 11783-10 task
with time log, CSV? `write_as_applied` does it.

Files:

- `as_applied`: What was applied where: a run log as stretches of ground, each with its area
- `columns`: The fields of the flat exports (CSV, GeoJSON, shapefile)
- `farm_record`: Passes for a farm's books
- `isoxml`: As-applied as an ISO 11783-10 task
- `stopped`: What a log's machine released while it was commanded to stop
- `time_log`: ISO 11783-10 time log (TLG)
- `write`: Writing an as-applied export in the format that the path's ending names
"""

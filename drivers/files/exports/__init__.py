"""How is a run log exported as what was applied where: GeoJSON, shapefile, ISO 11783-10 task
with time log, CSV? `write_as_applied` does it.

Files:

- `as_applied`: What was applied where: which stretches of ground did a run log work
- `columns`: Which columns do the flat exports (CSV, GeoJSON, shapefile) have?
- `farm_record`: Which passes does a farm's book hold, a line each as CSV
- `isoxml`: How is applied work written as an ISO 11783-10 task
- `stopped`: What did a log's machine release while it was commanded to stop
- `time_log`: How is an ISO 11783-10 time log (TLG) written
- `write`: How is an as-applied export written in the format of the path's ending
"""

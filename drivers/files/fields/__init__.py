"""How are fields of other programs read and written? They have outlines, obstacles, guidance lines
and a headland.

Files:

- `agopengps`: How is a field of AgOpenGPS read and written?
- `field_data`: How is a field of a file, in degrees, converted to the field of a job, on its plane
- `shapes`: How are fields read from and written to shapes (KML, KMZ, GeoPackage, GeoJSON
- `task_fields`: Which fields does an ISO 11783-10 task set contain?
- `worked_area`: Which ground has another program marked as worked?
"""

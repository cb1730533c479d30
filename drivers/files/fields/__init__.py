"""How are fields of other programs read and written: outlines, obstacles, guidance lines,
headland?

Files:

- `agopengps`: A field of AgOpenGPS: a folder with Field.txt, Boundary.txt, Headland.txt
- `done`: Ground that another program has marked as worked
- `field_data`: A field as files hold it, in degrees, and as a job holds it, on its plane
- `shapes`: Fields as shapes: polygons are outlines, lines are guidance lines; KML, KMZ, GeoPackage
- `task_fields`: Fields of an ISO 11783-10 task set
"""

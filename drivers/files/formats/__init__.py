"""Which formats of files does topdress read and write? Each module here is one format.

Files:

- `agopengps`: How is a field of AgOpenGPS, a folder, known, read and written?
- `file_format`: What does a format of files state about itself?
- `geojson`: How is GeoJSON (RFC 7946) known, read and written?
- `geopackage`: How is a GeoPackage (OGC 12-128r19) known, read and written?
- `geotiff`: How is a GeoTIFF (Cloud Optimized too) known and read?
- `kml`: How are KML (OGC 12-007r2) and KMZ known, read and written?
- `registry`: Which format has a file?
- `shapefile`: How is a shapefile known, read and written?
- `table`: How are tables known, read and written
- `task_file`: How is an ISO 11783-10 task file known, read and written?
"""

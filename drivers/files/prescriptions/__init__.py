"""How are prescription files read and written: ISO 11783-10 task files, shapefile, GeoJSON and
others? `read_prescription` recognises the format.

Files:

- `column_words`: What do the words of a column's name mean?
- `csv_zones`: How is a CSV read that has a polygon in a cell of each row?
- `data_dictionary`: What do identifiers of the data dictionary (ISO 11783-11) mean?
- `features`: How do polygons with attributes become zones?
- `for_job`: Which map, plant list, index map and worked ground does a job name?
- `grid_from_points`: How do points with a rate each, the centres of equal cells
- `isoxml_read`: How are ISO 11783-10 task files, versions 3 and 4, read?
- `projected`: How are metres of a transverse Mercator projection (UTM
- `raster`: How do rasters (GeoTIFF, Cloud Optimized GeoTIFF) become prescriptions?
- `read`: How is a prescription of any known format read?
- `shapes`: How are prescriptions read and written as polygons with attributes?
- `task_files`: Which files does an ISO 11783-10 data transfer contain
- `words`: Which choices does an operator have at the import of a prescription
- `write`: How is a prescription written?
"""

"""How are prescription files read and written: ISO 11783-10 task files, shapefile, GeoJSON and
others? `read_prescription` recognises the format.

Files:

- `column_words`: What do the words of a column's name mean?
- `csv_zones`: How is a CSV read that has a polygon in a cell of each row?
- `data_dictionary`: What do identifiers of the data dictionary (ISO 11783-11) mean?
- `features`: How do polygons with attributes become zones?
- `grid_from_points`: How do points with a rate each, the centres of equal cells
- `isoxml_read`: How are ISO 11783-10 task files, versions 3 and 4, read?
- `job_targets`: Which map, plant list, index map and worked ground does a job name?
- `map_choices`: Which choices does an operator have at the import of a prescription
- `map_projection`: How are metres of a transverse Mercator projection (UTM
- `map_reader`: How is a prescription of any known format read?
- `map_writer`: How is a prescription written?
- `raster`: How do rasters (GeoTIFF, Cloud Optimized GeoTIFF) become prescriptions?
- `shapes`: How are prescriptions read and written as polygons with attributes?
- `task_files`: Which files does an ISO 11783-10 data transfer contain
"""

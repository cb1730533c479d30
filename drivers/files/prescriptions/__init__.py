"""How are prescription files read and written: ISO 11783-10 task files, shapefile, GeoJSON and
others? `read_prescription` recognises the format.

Files:

- `column_words`: What the words of a column's name say that it is
- `csv_zones`: CSV with a polygon in a cell of each row (WKT
- `data_dictionary`: What numbers of the data dictionary (ISO 11783-11) mean, in words
- `features`: Polygons with attributes, as shapefile and GeoJSON have them, to zones
- `for_job`: Map, plant list, index map and done ground that a job names
- `isoxml_read`: ISO 11783-10 task files, versions 3 and 4: treatment zones, grids of type 1 and 2
- `lattice`: A prescription given as points
- `projected`: Metres of a transverse Mercator projection (UTM, Gauss-Krueger) to degrees
- `raster`: Rasters (GeoTIFF, Cloud Optimized GeoTIFF) as prescriptions
- `read`: Reading a prescription of any known format
- `shapes`: Prescriptions as polygons with attributes in GeoPackage, KML, KMZ, out too
- `task_files`: The files of an ISO 11783-10 data transfer, read and written
- `words`: What an operator chooses at an import, what comes out of it, and what goes wrong
- `write`: Writing a prescription: ISO 11783-10 task (zones, grid of type 1 or 2), GeoJSON
"""

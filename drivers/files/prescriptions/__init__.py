"""Prescription files, in and out: ISO 11783-10 task files, shapefile, GeoJSON.
`read_prescription` tells them apart."""

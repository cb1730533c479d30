"""As-applied exports of a run log: GeoJSON, shapefile, ISO 11783-10 task with time log, CSV.
`write_as_applied`."""

"""Export of results as labelled arrays with units, data frames, CSV and netCDF files."""

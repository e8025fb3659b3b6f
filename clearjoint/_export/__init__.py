"""Export of results: labelled arrays with units, data frames, CSV and netCDF files, and tables."""

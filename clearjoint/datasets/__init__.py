"""Ways out: results as labelled arrays with units, as data frames, CSV and netCDF files."""

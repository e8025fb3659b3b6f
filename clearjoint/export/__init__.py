"""Results as labelled arrays with units, data frames, CSV and netCDF files."""

"""A record of five horizons, fitted in windows."""

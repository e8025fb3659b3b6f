"""The runs of a sweep, computed side by side: lanes, the data that they record, and their
scheduler."""

"""The runs of a sweep side by side: lanes, the data they record, and their scheduler."""

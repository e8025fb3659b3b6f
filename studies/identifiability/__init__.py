"""What sensors can tell before there are data."""

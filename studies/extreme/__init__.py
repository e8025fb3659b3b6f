"""The study of extremes, in parts."""

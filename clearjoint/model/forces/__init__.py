"""Force elements without contact: springs, bushings and loads."""

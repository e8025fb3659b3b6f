"""Numbers of a scene by their places: listing, replacing, scaling and varying them, and the family
of scenes that parameters span. Nothing here runs anything."""

"""Films of oil between journal and bearing: laws of their force, and where they are in a joint."""

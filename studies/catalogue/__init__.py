"""Every entry of the catalogue beside something that nobody here computed."""

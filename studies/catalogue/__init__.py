"""Every entry of the catalogue compared with an independent result."""

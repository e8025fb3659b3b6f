"""Stores of a sweep's results on disk, and the digests by which a store recognises its sweep."""

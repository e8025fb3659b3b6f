"""Stores of sweep results on disk, and the digests by which a store recognises its sweep."""

"""Results of a sweep on disk, and by what a store knows its sweep again."""

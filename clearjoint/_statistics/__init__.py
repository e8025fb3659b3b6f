"""Statistics of many runs: ensembles, derivatives of averages, and global sensitivity."""

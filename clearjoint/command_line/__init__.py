"""The program `clearjoint`, which checks scene files and study files, and runs, sweeps and fits
them."""

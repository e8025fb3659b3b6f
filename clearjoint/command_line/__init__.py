"""The program `clearjoint`: checks, runs, sweeps and fits of scene and study files."""

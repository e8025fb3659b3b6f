"""The command-line program `clearjoint`. Its commands read a scene file, which describes a
mechanism, or a study file, which names a scene file and defines the computations."""

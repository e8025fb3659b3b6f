"""What a scene requires: a ladder of scenes, and planar programs to compare with."""

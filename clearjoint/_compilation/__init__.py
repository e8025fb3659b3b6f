"""Functions compiled by XLA, and the keys and files of compiled programs on disk.

Native programs are compiled by `clearjoint._native` instead of XLA, and their machine code is saved
here.
"""

"""Functions compiled by XLA, and the keys and files of compiled programs on disk.

Native programs are compiled by `clearjoint._native`, not XLA; their machine code is saved here.
"""

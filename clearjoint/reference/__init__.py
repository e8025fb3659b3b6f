"""Reference pages of all public names, generated from docstrings by pdoc.

`python -m clearjoint.reference` writes them; it needs the extra `reference`.
"""

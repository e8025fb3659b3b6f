"""Reference pages of all public names, generated from docstrings by pdoc.

``python -m clearjoint.reference`` writes them; it needs ``pip install "clearjoint[reference]"``.
"""

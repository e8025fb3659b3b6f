"""The documentation as searchable static pages: guide, studies, command line and public names.

``python -m clearjoint.reference`` writes them; it needs ``pip install "clearjoint[reference]"`` and
a clone of the repository. Zensical makes the pages from Markdown, and mkdocstrings those of the API
from docstrings. `site.toml` has their settings, their order and the names on each page of the API.
"""

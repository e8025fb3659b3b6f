"""Pages of every public name from its docstring, by pdoc: needs the extra `reference`.
`python -m clearjoint.reference` writes them."""

"""Pages of every public name from its docstring, with rendered equations: needs the extra
`reference`. `python -m clearjoint.reference` writes them."""

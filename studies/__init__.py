"""Studies of clearjoint: each folder is a study, run by `python -m studies.NAME`.

Studies import public names only: `clearjoint` and its `extend`, `plot`, `presets`, `quantities` and
`testing`.
"""

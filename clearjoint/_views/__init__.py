"""Three-dimensional views of a mechanism: of a state, or animated along a run.

Users call `view` in `viewing.py`. Joints and forces draw themselves by calling the methods of a pen
(`_model/pen.py`), such as `pin` and `spring`. The pen in `sketching.py` makes solids, from which
`page.py` makes a page for the browser, and `filming.py` makes pictures and animations.
"""

"""Three-dimensional views of a mechanism: of a state, or animated along a run.

Users call `view` of `viewing.py`. Joints and forces describe their shape to a pen
(`model/pen.py`); `sketching.py` makes solids, `page.py` a page for the browser, and `filming.py`
pictures and animations.
"""

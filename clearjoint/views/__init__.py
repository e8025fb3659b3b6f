"""Pictures of a mechanism in space: before a run, and moving after it.

`viewing.py` has `view`, which users call. Its elements say what they look like with a pen
(`model/pen.py`); `sketching.py` makes solids of that, `page.py` a page for the browser, and
`filming.py` an animation.
"""

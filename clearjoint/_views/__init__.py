"""Three-dimensional views of a mechanism, made by `view` in `viewing.py`.

Joints and forces draw themselves with a pen (`_model/pen.py`). The pen in `sketching.py` makes
solids, from which `page.py` makes a page for the browser, and `filming.py` pictures and animations.
A view has N frames, each of which shows the mechanism at one instant; a single state is one frame.
Points and directions are in global axes, lengths in m, poses homogeneous matrices (4, 4).
"""

"""Stores of a sweep's results on disk, and the digests by which a store recognises its sweep.

Labels are the values of the axes and of other dimensions, the digests by which lanes are
recognised, and the order of the lanes. In the arrays of the store's folder `by_lane`, each lane has
a row. The number of the row may differ from that of the lane, because lanes that are added later
get rows at the end. Beside this folder the store has a grid: a copy of the results along the axes,
for other programs.
"""

"""Parameter sweeps: their axes, outputs, execution, stores on disk, and labelled results; and a
search by sweeps for the largest value of a parameter for which quantities stay within limits.

A lane is one run of a sweep. Lanes are numbered from 0. They are all combinations of the axes'
values, those of the last axis varying fastest; in a zipped sweep the i-th lane has the i-th value
of each axis. Lanes are computed and stored in numbered chunks of equal size, except for the last. A
lane that has not been computed is pending.
"""

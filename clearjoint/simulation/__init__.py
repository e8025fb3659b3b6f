"""Integration in time: steps, complete runs, the lanes of sweeps, reductions (results such as a
peak, updated at every step) and the classes of results.

`clearjoint.sweeps` plans and stores sweeps, which consist of many runs.
"""

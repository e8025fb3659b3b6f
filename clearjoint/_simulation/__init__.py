"""Integration in time: steps, complete runs, runs of sweeps side by side (lanes), reductions
(results such as a peak, updated at every step) and the classes of results.

`clearjoint._sweeps` plans and stores sweeps, which consist of many runs.
"""

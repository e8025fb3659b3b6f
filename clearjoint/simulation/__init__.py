"""Integration in time: steps, complete runs, the lanes of sweeps, reductions and results.

`clearjoint.sweeps` plans and stores sweeps, which consist of many runs.
"""

"""Integration in time: steps that land on events, what is recorded of them, derivatives beside the
state, and the functions that users call for one run. What runs many is in `clearjoint.sweeps`."""

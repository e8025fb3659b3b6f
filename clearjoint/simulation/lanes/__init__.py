"""Computation of the runs of a sweep (lanes) side by side: steps and recorded data of a lane, and
the scheduler that distributes lanes to compiled loops."""

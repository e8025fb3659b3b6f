"""Computation of the runs of a sweep side by side. Each run is a lane. The modules contain the
steps and recorded data of a lane, a loop over lanes, and the scheduler that distributes lanes to
compiled loops."""

"""Computation of the runs of a sweep side by side: one lane, a loop over lanes, and the scheduler
that distributes lanes to compiled loops.

A turn is one iteration of the loop, in which each lane tries one step. A lane waits, unchanged,
when it has ended or needs something from Python, such as an empty buffer. A log is a table that a
lane writes: the crossings of a section, the impacts of a contact, or the saved states. A buffer
holds the rows of a log that Python has not read yet.
"""

"""Joints whose parts have play: the journal in its bearing and what acts there, balls, slots,
guides, backlash. What a contact force is, the laws say (`..contact`)."""

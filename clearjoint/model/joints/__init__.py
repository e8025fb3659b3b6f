"""Joints and forces between bodies: ideal, with clearance, drivers, springs, loads; and the
constraint rows and motion subspaces of which ideal ones consist."""

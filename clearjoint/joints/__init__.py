"""Everything that connects bodies: ideal joints, clearance joints, springs and loads."""

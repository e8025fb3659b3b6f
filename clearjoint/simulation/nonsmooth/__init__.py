"""Time stepping with rigid contacts (Moreau and Jean)."""

"""How often 95 % intervals of posteriors contain the truth."""

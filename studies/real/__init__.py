"""Fits to measurements of others: their files, models and fits."""

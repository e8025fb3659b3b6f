"""Posterior distributions of parameters by sequential Monte Carlo."""

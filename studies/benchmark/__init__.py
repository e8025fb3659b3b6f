"""What runs and sweeps cost, beside other programs."""

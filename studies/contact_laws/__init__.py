"""Contact laws: force against penetration, hysteresis, and what they deliver."""

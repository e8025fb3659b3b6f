"""The paper's double pendulum, with clearance and ideal."""

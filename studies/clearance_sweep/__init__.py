"""Effect of the clearance on the double pendulum."""

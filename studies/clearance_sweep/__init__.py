"""What the size of the clearance does to the double pendulum."""

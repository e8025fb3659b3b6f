"""Elements that drive a mechanism: prescribed motions, torques, motors, and functions of time."""

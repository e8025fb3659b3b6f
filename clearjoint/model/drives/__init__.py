"""Elements that drive joints: prescribed motions, functions of time, torques and motors."""

"""What moves joints: prescribed angles and distances, functions of time, torques, motors."""

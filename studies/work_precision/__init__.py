"""Work-precision diagrams of the paper's double pendulum: the parts of `studies.speed_accuracy`."""

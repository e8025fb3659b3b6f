"""Parameter sweeps: their axes, outputs, execution, stores on disk, and labelled results; and a
search by sweeps for the largest value of a parameter for which quantities stay within limits."""

"""Parameter sweeps: their axes, outputs, execution, stores on disk, and labelled results."""

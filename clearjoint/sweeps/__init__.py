"""Parameter sweeps: axes, outputs, execution of lanes, stores on disk, labelled results."""

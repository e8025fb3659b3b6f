"""Sweeps over parameters: axes, outputs, lanes on devices and executors, labelled results."""

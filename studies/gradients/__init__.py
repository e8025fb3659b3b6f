"""Gradients in reverse mode across impacts: accuracy, cost, and fits of many numbers."""

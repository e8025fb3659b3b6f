"""Mechanisms of the literature, each with the state that it starts from: a function a module."""

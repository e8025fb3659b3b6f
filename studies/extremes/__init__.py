"""Tested ranges of the numbers of a scene."""

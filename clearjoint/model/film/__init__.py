"""Lubricant films between journal and bearing: laws of their force."""

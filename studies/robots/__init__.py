"""Robots from files and logs."""

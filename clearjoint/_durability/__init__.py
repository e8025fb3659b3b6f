"""Wear that changes the profiles of bearings and journals over many cycles."""

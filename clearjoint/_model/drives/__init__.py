"""Drives (prescribed motions, torques and motors), and functions of time for drives and loads."""

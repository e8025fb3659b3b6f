"""Agreement with results that other programs have published."""

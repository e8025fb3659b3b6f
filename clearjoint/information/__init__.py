"""What data can tell of parameters: Fisher information, identifiability, horizons of
predictability."""

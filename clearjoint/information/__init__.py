"""Information of data about parameters: Fisher information, identifiability, and the longest record
that a fit can use."""

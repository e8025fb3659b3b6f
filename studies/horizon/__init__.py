"""For how long a record can be fitted by a single run."""

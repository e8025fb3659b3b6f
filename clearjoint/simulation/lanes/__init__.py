"""Many runs side by side: lanes, their records and their scheduling."""

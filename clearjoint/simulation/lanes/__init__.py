"""Many runs side by side: lanes, their recorders and their scheduler."""

"""Many runs side by side on devices: lanes, what they reduce and record, and their scheduling."""

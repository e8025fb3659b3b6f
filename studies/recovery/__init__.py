"""Parameters recovered from many draws of the noise."""

"""Statistics past the predictability horizon."""

"""What each feature of a scene costs, and that an absent one costs nothing."""

"""Information of measurements about parameters: identifiability, and the longest useful record."""

"""Contact with obstacles, and between bodies."""

"""How accurate the methods are, for how much work, and where they fail."""

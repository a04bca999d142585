"""Sums and extremes over particles and connections, for each world."""

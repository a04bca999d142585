"""Contact of particles with obstacles, fixed or moving: one rule for all shapes."""

"""Springs and dampers: the ways to sum their forces, plasticity and fracture."""

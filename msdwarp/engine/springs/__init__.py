"""Springs and dampers: force algorithms, plasticity and fracture."""

"""What is told of a state: energies, divergence, rates, sensors."""

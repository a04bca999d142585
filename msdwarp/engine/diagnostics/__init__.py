"""Measures of a state: energies, divergence, rates, probes."""

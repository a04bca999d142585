"""Adjoints of the launches of a substep: derivatives of a loss, from its end to its start."""

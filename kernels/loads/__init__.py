"""Loads: forces on particles besides spring forces, each a term in a scene's kernels."""

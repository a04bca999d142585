"""Derivatives of a loss: substeps are repeated and stored, and derivatives propagated back through them."""

"""Advance a state: assemble effects, launch stages, take substeps."""

"""Advances a state: assembles effects, launches stages, takes substeps."""

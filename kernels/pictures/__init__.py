"""Kernels of pictures: points, normals and colours from particles; a rasteriser, and a ray caster."""

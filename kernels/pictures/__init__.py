"""Kernels of pictures: points, normals and colors from particles; a rasteriser, and a ray caster."""

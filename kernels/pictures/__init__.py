"""Kernels of pictures: points, normals and colours that follow the particles; a rasteriser, and a ray caster."""

"""What is drawn: points, normals and colours that follow the particles; a rasteriser, and a ray caster."""

"""Contact between bodies: points on their surfaces against triangles, found with neighbor lists."""

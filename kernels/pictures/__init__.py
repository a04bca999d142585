"""What is drawn: points, normals and colours that follow the particles, and rays cast at them."""

from .drawing import STRAIN_STOPS, VALUE_STOPS, halve_over

__all__ = ["STRAIN_STOPS", "VALUE_STOPS", "halve_over"]

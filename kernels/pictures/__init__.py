"""What is drawn: points, normals and colours that follow the particles; a rasteriser, and a ray caster."""

from .arrows import HEAD, RINGS, SIDES, THICK, WIDE, place_arrows
from .drawing import STRAIN_STOPS, VALUE_STOPS, halve_over, lift

__all__ = [
    "HEAD",
    "RINGS",
    "SIDES",
    "STRAIN_STOPS",
    "THICK",
    "VALUE_STOPS",
    "WIDE",
    "halve_over",
    "lift",
    "place_arrows",
]

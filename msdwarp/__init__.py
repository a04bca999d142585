"""msdwarp: elastic bodies as particles joined by springs and dampers, on the GPU."""

from .colliders import Plane
from .integrators import (
    RK4,
    RKC2,
    ExplicitEuler,
    Integrator,
    Leapfrog,
    LinearlyImplicitEuler,
    SymplecticEuler,
)
from .measure import Measures
from .render import Renderer
from .scene import Look, Scene
from .shapes import box, chain, sheet
from .simulation import Frame, Simulation
from .stability import UnstableStep, stability_limit
from .system import Surface, System
from .watch import SimulationDiverged

__version__ = "0.1.0"

__all__ = [
    "RK4",
    "RKC2",
    "ExplicitEuler",
    "Frame",
    "Integrator",
    "Leapfrog",
    "LinearlyImplicitEuler",
    "Look",
    "Measures",
    "Plane",
    "Renderer",
    "Scene",
    "Simulation",
    "SimulationDiverged",
    "Surface",
    "SymplecticEuler",
    "System",
    "UnstableStep",
    "box",
    "chain",
    "sheet",
    "stability_limit",
]

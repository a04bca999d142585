"""msdwarp: elastic bodies as particles joined by springs and dampers, on the GPU."""

from .colliders import Box, Capsule, Cone, Plane, Sphere
from .dampers import CoulombDamper, QuadraticDamper
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
from .surface import Surface
from .system import System
from .watch import SimulationDiverged

__version__ = "0.1.0"

__all__ = [
    "RK4",
    "RKC2",
    "Box",
    "Capsule",
    "Cone",
    "CoulombDamper",
    "ExplicitEuler",
    "Frame",
    "Integrator",
    "Leapfrog",
    "LinearlyImplicitEuler",
    "Look",
    "Measures",
    "Plane",
    "QuadraticDamper",
    "Renderer",
    "Scene",
    "Simulation",
    "SimulationDiverged",
    "Sphere",
    "Surface",
    "SymplecticEuler",
    "System",
    "UnstableStep",
    "box",
    "chain",
    "sheet",
    "stability_limit",
]

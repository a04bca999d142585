"""msdwarp: elastic bodies as particles joined by springs and dampers, on the GPU."""

from .colliders import Plane
from .integrators import RK4, Integrator, Leapfrog, SymplecticEuler
from .render import Renderer
from .scene import Look, Scene
from .shapes import box, chain, sheet
from .simulation import Frame, Simulation, SimulationDiverged
from .system import Surface, System

__version__ = "0.1.0"

__all__ = [
    "RK4",
    "Frame",
    "Integrator",
    "Leapfrog",
    "Look",
    "Plane",
    "Renderer",
    "Scene",
    "Simulation",
    "SimulationDiverged",
    "Surface",
    "SymplecticEuler",
    "System",
    "box",
    "chain",
    "sheet",
]

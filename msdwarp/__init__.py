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
from .materials import COTTON, FOAM, JELLY, RUBBER, STEEL_WIRE, Material
from .measure import Measures
from .meshes import from_mesh
from .outlines import cloth
from .picture import Scale
from .render import Renderer
from .scene import Look, Scene
from .schedule import at
from .shapes import box, chain, lattice, sheet
from .simulation import Frame, Simulation
from .solids import ball, cone, cylinder
from .stability import UnstableStep, stability_limit
from .surface import Surface
from .system import System
from .trajectory import Trajectory
from .watch import SimulationDiverged
from .writer import TrajectoryWriter

__version__ = "0.1.0"

__all__ = [
    "COTTON",
    "FOAM",
    "JELLY",
    "RK4",
    "RKC2",
    "RUBBER",
    "STEEL_WIRE",
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
    "Material",
    "Measures",
    "Plane",
    "QuadraticDamper",
    "Renderer",
    "Scale",
    "Scene",
    "Simulation",
    "SimulationDiverged",
    "Sphere",
    "Surface",
    "SymplecticEuler",
    "System",
    "Trajectory",
    "TrajectoryWriter",
    "UnstableStep",
    "at",
    "ball",
    "box",
    "chain",
    "cloth",
    "cone",
    "cylinder",
    "from_mesh",
    "lattice",
    "sheet",
    "stability_limit",
]

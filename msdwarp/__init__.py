"""msdwarp: elastic bodies as particles joined by springs and dampers, on the GPU."""

from .bodies import (
    COTTON,
    FOAM,
    JELLY,
    RUBBER,
    STEEL_WIRE,
    CoulombDamper,
    Frame,
    Material,
    QuadraticDamper,
    Surface,
    System,
)
from .checks import DoubtfulStart
from .engine import Measures
from .files import Trajectory, TrajectoryWriter
from .integrators import (
    RK4,
    RKC2,
    ExplicitEuler,
    Integrator,
    Leapfrog,
    LinearlyImplicitEuler,
    SymplecticEuler,
    UnstableStep,
    stability_limit,
)
from .pictures import Renderer, Scale
from .quiet import verbose
from .shapes import ball, box, chain, cloth, cone, cylinder, from_mesh, lattice, sheet
from .simulation import Simulation, SimulationDiverged
from .world import Box, Capsule, Cone, Look, Plane, Scene, Sphere, at

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
    "DoubtfulStart",
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
    "verbose",
]

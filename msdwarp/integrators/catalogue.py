"""The methods by name, for the command line and for studies.

Each method is a file in this folder (`base.py` defines its interface), with kernels in `kernels/integrators`.
"""

from .base import Integrator
from .leapfrog import Leapfrog
from .linearly_implicit_euler import LinearlyImplicitEuler
from .rk4 import RK4
from .rkc2 import RKC2
from .symplectic_euler import SymplecticEuler

METHODS: dict[str, Integrator] = {
    "symplectic-euler": SymplecticEuler(),
    "leapfrog": Leapfrog(),
    "leapfrog-extrapolated": Leapfrog(damper_extrapolation=0.5),
    "rk4": RK4(),
    "rkc2": RKC2(),
    "linearly-implicit-euler": LinearlyImplicitEuler(),
}
"""The methods offered by the command line, by name."""
DEFAULT = "symplectic-euler"

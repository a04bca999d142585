"""Methods of time stepping, one file each, and the steps that are stable for them."""

from .base import Integrator
from .catalogue import DEFAULT, METHODS
from .explicit_euler import ExplicitEuler
from .leapfrog import Leapfrog
from .linearly_implicit_euler import LinearlyImplicitEuler
from .rk4 import RK4
from .rkc2 import RKC2
from .stability import (
    MOST_SUBSTEPS,
    SAFETY,
    StepChoice,
    UnstableStep,
    asked_by,
    choose_forced,
    choose_stable,
    match_stiffness,
    stability_limit,
)
from .symplectic_euler import SymplecticEuler

"""Methods of time stepping, one file each, and the steps that are stable for them."""

from .base import Integrator as Integrator
from .catalogue import DEFAULT as DEFAULT, METHODS as METHODS
from .explicit_euler import ExplicitEuler as ExplicitEuler
from .leapfrog import Leapfrog as Leapfrog
from .linearly_implicit_euler import LinearlyImplicitEuler as LinearlyImplicitEuler
from .rk4 import RK4 as RK4
from .rkc2 import RKC2 as RKC2
from .stability import (
    MOST_SUBSTEPS as MOST_SUBSTEPS,
    SAFETY as SAFETY,
    StepChoice as StepChoice,
    UnstableStep as UnstableStep,
    asked_by as asked_by,
    choose_forced as choose_forced,
    choose_stable as choose_stable,
    match_stiffness as match_stiffness,
    stability_limit as stability_limit,
)
from .symplectic_euler import SymplecticEuler as SymplecticEuler

"""Contact of particles with obstacles: one rule for all, fixed or moving, whatever their shape."""

from .depths import distances
from .distance import KINDS, signed_distance, solids
from .felt import mean_forces, sum_impulses
from .obstacles import NO_CONTACT, Contact, NoColliders, fixed_contact, moving_contact
from .rule import Needed

__all__ = [
    "KINDS",
    "NO_CONTACT",
    "Contact",
    "Needed",
    "NoColliders",
    "distances",
    "fixed_contact",
    "mean_forces",
    "moving_contact",
    "signed_distance",
    "solids",
    "sum_impulses",
]

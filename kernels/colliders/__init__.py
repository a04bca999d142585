"""Contact of particles with obstacles: one rule for all, fixed or moving, whatever their shape."""

from .collide import NO_COLLIDERS, ColliderTerm, NoColliders, fixed_contact, moving_contact
from .contact_forces import mean_forces, sum_impulses
from .contact_rule import Needed
from .penetration_depth import distances
from .signed_distance import KINDS, signed_distance, solids

__all__ = [
    "KINDS",
    "NO_COLLIDERS",
    "ColliderTerm",
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

"""Contact of particles with obstacles, fixed or moving: one rule for all shapes."""

from .collide import NO_COLLIDERS, ColliderTerm, collider_contact
from .contact_forces import mean_forces, sum_impulses
from .penetration_depth import distances
from .signed_distance import KINDS, signed_distance, solids
from .soft_colliders import soft_adjoint, soft_colliders

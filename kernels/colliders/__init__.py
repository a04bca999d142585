"""Contact of particles with obstacles, fixed or moving: one rule for all shapes."""

from .collide import (
    NO_COLLIDERS as NO_COLLIDERS,
    ColliderTerm as ColliderTerm,
    collider_contact as collider_contact,
)
from .contact_forces import mean_forces as mean_forces, sum_impulses as sum_impulses
from .penetration_depth import distances as distances
from .signed_distance import KINDS as KINDS, signed_distance as signed_distance, solids as solids
from .soft_colliders import soft_adjoint as soft_adjoint, soft_colliders as soft_colliders

"""What a system moves in: obstacles, changes on the way (`at`), how it looks, and all together in a `Scene`."""

from .colliders import Box, Capsule, Collider, Cone, Plane, Sphere
from .in_time import sampled
from .loads import Force, Load, check_loads
from .look import Look
from .motion import Motion, pose, poses
from .scene import Scene
from .schedule import Change, at
from .stored_scene import Stored, known_until, scene_as_stored, scene_from_stored

__all__ = [
    "Box",
    "Capsule",
    "Change",
    "Collider",
    "Cone",
    "Force",
    "Load",
    "Look",
    "Motion",
    "Plane",
    "Scene",
    "Sphere",
    "Stored",
    "at",
    "check_loads",
    "known_until",
    "pose",
    "poses",
    "sampled",
    "scene_as_stored",
    "scene_from_stored",
]

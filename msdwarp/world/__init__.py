"""What a system moves in: obstacles, changes on the way (`at`), how it looks, and all together in a `Scene`."""

from .actuators import Actuator
from .attachments import Attachment, MouseSpring
from .colliders import Box, Capsule, Collider, Cone, Plane, Sphere
from .contact import Contact, with_contact
from .drives import Driven, PrescribedMotion, bound, driven_particles
from .gravity import Falling, Gravity, gravity_at, gravity_in_words, with_potential
from .loads import Force, Load, check_loads, differ_in_values, is_device_function
from .look import Look
from .motion import Motion, pose, poses
from .pressure import EnclosedGas, Pressure, volume
from .probes import (
    BODY_CONTACT_FORCE,
    CONTACT_FORCE,
    FORCE,
    FRAME,
    POSITION,
    QUANTITIES,
    STRAIN,
    SUBSTEP,
    VELOCITY,
    Probe,
    checked_probes,
    probe_columns,
    probes_by,
)
from .scene import Scene
from .schedule import Change, at
from .stored_scene import Stored, known_until, scene_as_stored, scene_from_stored
from .time_functions import sampled
from .wind import Wind

__all__ = [
    "BODY_CONTACT_FORCE",
    "CONTACT_FORCE",
    "FORCE",
    "FRAME",
    "POSITION",
    "QUANTITIES",
    "STRAIN",
    "SUBSTEP",
    "VELOCITY",
    "Actuator",
    "Attachment",
    "Box",
    "Capsule",
    "Change",
    "Collider",
    "Cone",
    "Contact",
    "Driven",
    "EnclosedGas",
    "Falling",
    "Force",
    "Gravity",
    "Load",
    "Look",
    "Motion",
    "MouseSpring",
    "Plane",
    "PrescribedMotion",
    "Pressure",
    "Probe",
    "Scene",
    "Sphere",
    "Stored",
    "Wind",
    "at",
    "bound",
    "check_loads",
    "checked_probes",
    "differ_in_values",
    "driven_particles",
    "gravity_at",
    "gravity_in_words",
    "is_device_function",
    "known_until",
    "pose",
    "poses",
    "probe_columns",
    "probes_by",
    "sampled",
    "scene_as_stored",
    "scene_from_stored",
    "volume",
    "with_contact",
    "with_potential",
]

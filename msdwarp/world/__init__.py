"""The surroundings of a system: obstacles, loads, scheduled changes (`at`) and looks, combined in a `Scene`."""

from .actuators import Actuator, StrainRows
from .attachments import Attachment, MouseSpring as MouseSpring
from .colliders import Box, Capsule, Collider, Cone, Plane, Sphere
from .contact import Contact, radii
from .drives import Driven, PrescribedMotion, bound, driven_particles
from .gravity import Falling, Gravity, gravity_at, gravity_in_words, with_potential
from .loads import ElementLoad, Force, Load, check_loads, differ_in_values, is_device_function
from .look import FINISHES, Look, Reflectance, Viewpoint
from .motion import Motion, displacement_and_turn, poses
from .pressure import EnclosedGas, Pressure, volume
from .probes import (
    BODY_CONTACT_FORCE,
    CONTACT_FORCE,
    FORCE,
    FRAME,
    POSITION,
    QUANTITIES,
    STRAIN,
    STRESS,
    SUBSTEP,
    TENSION,
    UNITS,
    VELOCITY,
    WRENCH,
    Probe,
    checked_probes,
    probe_columns,
    probes_by,
)
from .problem import Problem
from .scene import Scene, observed_values
from .schedule import Change, at
from .stored_scene import known_until, scene_as_stored, scene_from_stored
from .time_functions import sampled
from .wind import Wind

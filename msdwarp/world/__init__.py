"""The surroundings of a system: obstacles, loads, scheduled changes (`at`) and looks, combined in a `Scene`."""

from .actuators import Actuator as Actuator
from .attachments import Attachment as Attachment, MouseSpring as MouseSpring
from .colliders import (
    Box as Box,
    Capsule as Capsule,
    Collider as Collider,
    Cone as Cone,
    Plane as Plane,
    Sphere as Sphere,
)
from .contact import Contact as Contact, with_contact as with_contact
from .drives import (
    Driven as Driven,
    PrescribedMotion as PrescribedMotion,
    bound as bound,
    driven_particles as driven_particles,
)
from .gravity import (
    Falling as Falling,
    Gravity as Gravity,
    gravity_at as gravity_at,
    gravity_in_words as gravity_in_words,
    with_potential as with_potential,
)
from .loads import (
    Force as Force,
    Load as Load,
    check_loads as check_loads,
    differ_in_values as differ_in_values,
    is_device_function as is_device_function,
)
from .look import FINISHES as FINISHES, Look as Look, Reflectance as Reflectance, Viewpoint as Viewpoint
from .motion import Motion as Motion, displacement_and_turn as displacement_and_turn, poses as poses
from .pressure import EnclosedGas as EnclosedGas, Pressure as Pressure, volume as volume
from .probes import (
    BODY_CONTACT_FORCE as BODY_CONTACT_FORCE,
    CONTACT_FORCE as CONTACT_FORCE,
    FORCE as FORCE,
    FRAME as FRAME,
    POSITION as POSITION,
    QUANTITIES as QUANTITIES,
    STRAIN as STRAIN,
    STRESS as STRESS,
    SUBSTEP as SUBSTEP,
    UNITS as UNITS,
    VELOCITY as VELOCITY,
    Probe as Probe,
    checked_probes as checked_probes,
    probe_columns as probe_columns,
    probes_by as probes_by,
)
from .scene import Scene as Scene, observed_values as observed_values
from .schedule import Change as Change, at as at
from .stored_scene import (
    known_until as known_until,
    scene_as_stored as scene_as_stored,
    scene_from_stored as scene_from_stored,
)
from .time_functions import sampled as sampled
from .wind import Wind as Wind

"""Numbers that no simulation can have are refused at the call, by the argument's name, before anything starts."""

import itertools
import re

import numpy as np
import pytest

import msdwarp as msd

BODY = msd.sheet((3, 3), 0.1).named("all of it")
PAIR = msd.chain(2, 0.1)
OTHER, FOAM = PAIR.translate((0, 0, 0.1)), msd.Material(1e3, 1e5)
STRAINS = "yield_strain relaxation_time break_strain break_force"


def of(make, *fixed, **others):
    """Return, by argument, what makes something with a value of it."""
    return lambda name: lambda value: make(*fixed, **(others | {name: value}))


def load(kind, **others):
    """Return the same of a load in a scene of which a simulation is made."""

    def make(**given):
        scene = msd.Scene(system=BODY, loads=[kind(**(others | given))])
        return msd.Simulation.from_scene(scene, device="cpu")

    return of(make)


def scene(**given):
    return msd.Simulation.from_scene(msd.Scene(system=BODY, **given), device="cpu")


def change(**given):
    msd.Simulation(BODY, device="cpu").change(**given)


def still(t):
    return (0.0, 0.0, 0.0)


# What makes something, and of its arguments those that must be above 0, at least 0, and any finite number.
MAKERS = {
    "chain": (of(msd.chain, 3), "spacing mass", "stiffness damping", ""),
    "box": (of(msd.box, (2, 2, 2)), "spacing mass", "stiffness damping", ""),
    "ball": (of(msd.ball, radius=0.2, spacing=0.1), "radius spacing mass", "stiffness damping", ""),
    "cylinder": (of(msd.cylinder, radius=0.2, height=0.2, spacing=0.1), "radius height spacing", "", ""),
    "cone": (of(msd.cone, radius=0.2, height=0.2, spacing=0.1), "radius height spacing", "", ""),
    "icosphere": (of(msd.icosphere, subdivisions=1), "radius", "", ""),
    "sheet": (of(msd.sheet, (3, 3)), "spacing mass", "stiffness damping bending", ""),
    "a sheet of a material": (of(msd.sheet, (3, 3), material=FOAM, thickness=1e-3), "thickness", "", ""),
    "shell": (of(msd.shell, msd.icosphere(0.5, 1)), "total_mass", "stiffness damping folding tension", ""),
    "join": (of(msd.join, PAIR, OTHER, within=1.0, stiffness=1.0), "within rest_length", "stiffness damping", ""),
    "fields": (of(BODY.replace), "mass rest_length", f"stiffness damping {STRAINS}", "velocity"),
    "translate": (of(BODY.translate), "", "", "displacement"),
    "spin": (of(BODY.spin), "", "", "angular_velocity"),
    "material": (of(msd.Material, density=1e3, youngs_modulus=1e5), "density youngs_modulus", "", ""),
    "quadratic": (of(msd.QuadraticDamper), "most_speed", "", ""),
    "Plane": (of(msd.Plane), "", "friction rest_speed", "offset"),
    "Sphere": (of(msd.Sphere), "radius", "friction rest_speed", "position"),
    "Capsule": (of(msd.Capsule), "radius", "friction rest_speed", "start end"),
    "Cone": (of(msd.Cone), "radius", "friction rest_speed", "apex base"),
    "Box": (of(msd.Box), "size", "friction rest_speed", "position"),
    "Force": (load(msd.Force), "", "", "force"),
    "Wind": (load(msd.Wind, velocity=(1.0, 0.0, 0.0)), "", "drag lift density area", "velocity"),
    "Pressure": (load(msd.Pressure), "", "", "pressure"),
    "Attachment": (load(msd.Attachment, on=[0], stiffness=1.0), "", "stiffness damping", "to"),
    "Actuator": (load(msd.Actuator, strain=0.1), "", "", "strain delay"),
    "Drive": (load(msd.PrescribedMotion, on=[0], motion=still), "", "", "about"),
    "Contact": (of(msd.Contact), "stiffness thickness", "friction", ""),
    "scene": (of(scene), "", "", "gravity"),
    "duration": (of(scene), "duration", "", ""),
    "simulation": (of(msd.Simulation, BODY, device="cpu"), "fps", "", "gravity"),
    "at": (of(lambda **given: scene(schedule=[msd.at(0.0, **given)]).step()), "", "", "gravity"),
    "at once": (of(change), "mass rest_length", "stiffness damping", "velocity gravity"),
}
VECTORS = {"velocity", "displacement", "angular_velocity", "force", "to", "about", "position", "start", "end"}
VECTORS |= {"apex", "base", "size"}
UNBOUNDED = {"mass", "yield_strain", "break_strain", "break_force", "friction"}
"""inf says something: pinned, never yields, never slides."""


def value_of(name, value):
    vector = name in VECTORS and not isinstance(value, str)
    return (value,) * 3 if vector else value


ABSURD = (1e308, -1e308, 1e30, np.nan, np.inf, -1.0, 1e-320, "1")
FIRST = re.compile(r"((?:loads|schedule)\[0\]\.)?(colliders\[0\]\.)?(\w[\w ]*?)(\[[\d, ]+\])* (is|must|has)")


@pytest.mark.parametrize("maker", MAKERS)
def test_an_absurd_number_is_refused_by_the_name_of_its_argument(maker):
    of_argument, *kinds = MAKERS[maker]
    for least, names in zip(("above", "at least", "any"), kinds, strict=True):
        for name, value in itertools.product(names.split(), ABSURD):
            allowed = {-1.0: least == "any", 1e-320: least != "above", np.inf: name in UNBOUNDED}
            if allowed.get(value, False):
                continue
            with pytest.raises(ValueError, match=rf"\b{name}\b.*(is|must be|are) ") as told:
                pytest.fail(f"{name}={value!r} gives {of_argument(name)(value_of(name, value))}")
            first = FIRST.match(str(told.value))
            assert first, told.value
            assert first[3] == name, told.value
            assert (first[1] == "schedule[0].") == (maker == "at")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: msd.Contact(groups=3), "groups is 3; it must be two names of groups"),
        (lambda: scene(contact=3), "contact is 3; it must be a sequence of Contact"),
        (lambda: scene(schedule=[msd.at(0.0, unpin="x")]), "unpin is 'x'; it must be one of 'all of it'"),
        (lambda: scene(schedule=[msd.at(0, group="x", mass=1.0)]), "group is 'x'; it must be one of 'all of it'"),
        (lambda: scene(loads=[msd.Force((0, 0, 1), on="x")]), "loads[0].on is 'x'; it must be one of 'all of it'"),
        (lambda: msd.Simulation(BODY, device="cpu").change(unpin="x"), "unpin is 'x'; it must be one of"),
    ],
)
def test_what_is_no_name_is_refused_by_the_argument_that_has_it(call, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        call()

"""Guesses: names that users of other programs try first, and errors that lead from them to the names there are.

`guide` does this for all public classes and functions where `msdwarp` imports them. Their files know nothing of
it, nor do type checkers; `help` and `inspect.signature` show what they would without.
"""

import difflib
import functools
import inspect
import re
from collections.abc import Callable, Iterable
from typing import Any

from .turns import unseen

_MATERIAL = "material=Material(density=..., youngs_modulus=..., poissons_ratio=...)"
_STEP = "substeps, the steps of a frame (by default as many as are stable), and fps, the frames per second"
_LOOK = "Look(azimuth=..., elevation=..., distance=...)"
_WINDOW = "msdwarp.view(scene), or msdwarp.film(scene, path)"
_WORLDS = (
    "worlds, which may differ in stiffness, damping, rest_length, mass, position, velocity, gravity, friction, "
    "and strain and delay of actuators, alone"
)
_GAIT = "strain, a function of time, such as lambda t: amplitude * np.sin(2 * np.pi * frequency * t + phase)"
_ALL = "measure(), which returns kinetic_energy, elastic_energy and more"
KEYWORDS = {
    "stiffness": "k ke ks spring_constant spring_stiffness",
    "damping": "b c d kd damping_coefficient",
    _MATERIAL: "density rho young young_modulus youngs_modulus E Y poisson poissons_ratio nu",
    "worlds, whose stiffness is factors[:, None] * system.stiffness: without cells these scale Young's modulus": (
        "youngs_modulus young young_modulus E"
    ),
    "youngs_modulus": "young young_modulus E Y",
    "poissons_ratio": "nu poisson",
    "density": "rho",
    "radius": "r",
    "offset": "height level z",
    "worlds": "n num count num_worlds n_worlds num_envs",
    "velocity, a vector, or a function of time": "speed direction gust",
    "force": "value vector",
    "motion, a function of time": "path trajectory velocity",
    "count, which is the length over the spacing plus one": "length",
    "area, that of the cross section": "radius diameter",
    "fps, of the film: in slow motion it is below that of the frames": "slow_motion slowmo",
    "mass": "m mass_per_particle weight",
    "shape": "size dims dimensions n_particles resolution half_extents extents",
    "spacing": "dx h cell_size edge_length quad_size pitch size",
    "count": "n num segments",
    "system": "body bodies objects",
    "colliders": "obstacles ground floor walls",
    "loads": "forces force muscles wind",
    "turn": "rotation orientation",
    "duration, while fps is an argument of Simulation, run and film": "fps frame_rate",
    "probes": "sensors",
    "contact": "collision collisions self_collision",
    "friction": "mu lateral_friction friction_coefficient sliding_friction",
    "restitution": "e bounce bounciness elasticity restitution_coefficient",
    _STEP: "dt timestep time_step h step_size",
    "integrator": "method solver scheme",
    "precision": "dtype",
    "device": "arch backend gpu",
    "duration": "seconds time t_end length steps",
    "position": "center centre pos origin location translation",
    "displacement": "xyz offset shift vector by",
    "size": "x_length lengths half_extents extents bounds",
    "resolution": "window_size size width",
    "color": "colour",
    "folding, a stiffness [N/m]": "bending",
    "coloring": "colouring color",
    "fraction": "share",
    "film": "video movie",
    "out": "folder output path directory",
    "break_force": "max_force strength breaking_force tear_force",
    "distance": "zoom camera_distance",
    "azimuth, elevation, distance and target": "camera view viewpoint",
    _GAIT: "amplitude frequency phase gait actuation actuators",
    _WORLDS: "density poissons_ratio restitution damping_ratio break_strain parameters cells",
}
"""What an unknown keyword may mean: a parameter, perhaps with more words, and the guesses that lead to it.

Only parameters that a function has are named; the text may go on after the name, from a "=" or a comma.
"""
NAMES: dict[str, dict[str, str]] = {
    "msdwarp": {
        "cloth or sheet, with Wind": "flag",
        "from_mesh, of pyvista.ParametricEllipsoid(a, b, c)": "egg ellipsoid",
        "from_mesh, of pyvista.ParametricTorus(ringradius=..., crosssectionradius=...)": "torus",
        "Material(density=..., youngs_modulus=...), or CORK": "WOOD",
        "Wind": "Fan",
        "fit, to a measured motion, sweep, or Simulation.gradient": "optimize calibrate minimize",
        "sweep": "grid_search",
        "chain": "rope string cable line beads",
        "ball, which is a body, or Sphere, an obstacle": "sphere",
        "box": "cube cuboid block brick grid3d",
        "sheet or cloth, which are bodies, or Plane, an obstacle": "plane",
        "sheet or cloth": "grid fabric net",
        "shell, with a tension, or sheet": "membrane drum_skin",
        "shell or from_mesh, of a PyVista mesh": "dome hemisphere revolve",
        "a pinned shell, with Contact, as no obstacle is a mesh": "heightfield terrain",
        "System(position=..., mass=...)": "grains",
        "System(position=..., mass=..., connections=...)": "from_springs network particles_and_springs",
        "Spring, a law, or System(connections=...)": "spring law",
        "PolynomialSpring or ExponentialSpring": "Progressive",
        "LimitedSpring or TensionOnlySpring": "slack",
        "the field rest_length of a System": "pretension stretch prestress",
        "Wind, or a Force of velocity": "Drag",
        "System, or a function that makes one, such as box, ball, sheet or from_mesh": (
            "body SoftBody particles Model MassSpringSystem geom"
        ),
        "from_mesh, of a PyVista mesh, or from_volume, which reads files": (
            "load_mesh read_mesh mesh loadSoftBody load_obj from_file"
        ),
        "voxels": "voxel from_voxels from_array add_from_array",
        "voxels, of a 3D array, or lattice, of a mask in 2D too": "pixels",
        "box, a solid, or rod": "beam plank bar",
        "disc": "circle drum",
        "Plane": "ground floor wall HalfSpace",
        "cylinder, which is a body, or Capsule, an obstacle": "Cylinder",
        "Plane, Sphere, Box, Capsule or Cone": "obstacle createCollisionShape shape",
        "Probe": "Sensor ForceSensor LoadCell site",
        'Probe([i, j], "tension"), in the argument probes of Scene and Simulation': (
            "tension spring_force spring_forces spring_tension"
        ),
        _LOOK: "camera light",
        "Scene": "World Environment Stage",
        "Actuator": "motor Muscle",
        "PrescribedMotion": "Drive Driven Moving boundary",
        "System.with_velocity": "Throw",
        "the fields break_force and break_strain of a System": "Tear Breaking Break Fracture max_force",
        "the argument probes of Scene and Simulation, whose readings it keeps": "record",
        "run(scene, out), which stores all frames, or TrajectoryWriter": "Recorder write save",
        "msdwarp export FILE --to glb, or usd, in a shell, of a run that msdwarp.run has stored": (
            "export export_gltf to_gltf to_usd export_usd"
        ),
        "Renderer(scene, positions).image(positions), an array of pixels": (
            "image picture still save_image screenshot"
        ),
        "TrackedPoints, for fit": "Measurement",
        "modes": "eigenmodes eigenfrequencies normal_modes",
        "Simulation.settle, or Scene(settled=True)": "settle relax",
        "PrescribedMotion, or System.pin": "pin fixed anchor constraint fix createSoftBodyAnchor equality mocap",
        "Attachment or join": "tie weld attach createConstraint joint hinge tendon sew seam stitch knot",
        "join": "connect glue",
        "Trajectory(path)": "load read open open_trajectory",
        _WINDOW: "render animate gui ui window plotter viewer launch_passive",
        "msdwarp.view(scene), msdwarp.film(scene, path), or msdwarp plot in a shell, for energies": "plot",
        "run(scene, out)": "simulate main",
        "the argument device of Simulation and run": "init device cpu gpu cuda",
        "the argument gravity of Scene and Simulation": "gravity",
        "Simulation.step": "step stepSimulation mj_step",
        "Simulation.reset": "reset resetSimulation mj_resetData",
        "arguments of Simulation, such as integrator, substeps and gravity": "option params config settings",
        "an array of NumPy, as all functions take": "array zeros ones linspace vec3 Vector Matrix field",
        "Contact": "collision friction collide",
        "a + b, sum([a, b]), or join": "combine concatenate merge stack hstack vstack append",
        "SymplecticEuler, Leapfrog, RK4, RKC2 or LinearlyImplicitEuler": (
            "Euler SemiImplicitEuler ImplicitEuler Verlet VelocityVerlet RungeKutta"
        ),
    },
    "System": {
        "translate": "move shift set_position",
        "pin": "fix anchor clamp freeze hold",
        "position, by which a mask is made, such as system.position[:, 2] < 0.1": "where",
        "pinned, which is False where a particle is free": "free",
        "group(name), or pinned, which are masks": "mask",
        "replace(mass=...), or at(time, unpin=...) in a schedule": "unpin",
        "msdwarp.Look(color=...), in the argument look of Scene": "color colour",
        "cells, if not None, whose volumes(position) sum to it": "volume",
        "position": "positions x points vertices q xpos coords pos",
        "velocity": "velocities v vel qvel",
        "mass": "masses m",
        "connections": "springs edges links lines",
        "surface.triangles": "faces triangles",
        "position.min(axis=0) and position.max(axis=0)": "bounds extent bounding_box aabb",
        "center_of_mass": "center centre com centre_of_mass centroid mean",
        "the system itself, which never changes: its methods return a new one": "copy clone deepcopy",
        "rotate(angle, axis), by radians": "rotate_x rotate_y rotate_z turn",
        _WINDOW: "plot show render view draw",
        "particle_count": "n_points num_particles n_particles size n count shape nbody",
        "connection_count": "n_cells n_springs num_springs n_edges",
        "dim": "ndim dimension",
        "mass.sum()": "total_mass get_mass_total weight",
        "pin(mask), or System of chosen particles and connections": "clip extract extract_points threshold",
        "rotate or scale": "transform reflect flip mirror",
        "the arrays of its fields, such as position": "points_data point_data array dtype T numpy to_numpy",
        "a + b or sum([a, b])": "merge append add concatenate join combine",
        "replace": "update with_stiffness with_mass",
        "with_velocity or spin": "set_velocity throw push apply_force",
        "msdwarp.TrajectoryWriter, or msdwarp.run": "save write export",
    },
    "Scene": {
        "msdwarp.run(scene, out), or msdwarp.Simulation(scene)": "run simulate step play",
        _WINDOW: "show view render plot film draw",
        "replace": "update copy",
        "system": "body bodies model",
        "colliders": "obstacles ground_planes",
        "replace(system=scene.system + body)": "add add_body append",
        "replace(colliders=[...])": "add_collider add_obstacle add_ground",
        "replace(loads=[...])": "add_force add_load",
    },
    "Simulation": {
        "step(frames), or frames(duration), which yields them": (
            "run advance simulate forward play integrate stepSimulation mj_step"
        ),
        "problem, with system, colliders and loads": "scene",
        "time": "t",
        "frame().position": "position x points qpos",
        "frame().velocity": "velocity velocities v qvel",
        _ALL: "energy kinetic_energy potential_energy elastic_energy total_energy momentum get_energy",
        "msdwarp.film(simulation, path, duration=...)": "film record video animate movie render",
        "msdwarp.view(scene), msdwarp.show or msdwarp.Renderer": "view show plot draw image",
        "snapshot(), which returns a System": "get_state body copy particles",
        "msdwarp.run, which stores all, or msdwarp.TrajectoryWriter": "save write export dump",
        "change": "update set_gravity set_stiffness set_parameters",
        "loads of the scene, such as Force": "apply_force add_force applyExternalForce",
        "reset": "resetSimulation restart",
        "loads, such as Actuator(strain), with functions of time": "ctrl control act actuators",
        "frame(), measure() and snapshot()": "data results output observation obs",
        "step, whose substeps are automatic": "substep integrate_step mj_step1",
        "substeps, of a frame of 1 / fps seconds": "timestep time_step",
        "contact_force()": "contacts contact_forces contact_points",
        "change(colliders=...)": "add_collider set_colliders",
        "readings, of the argument probes": "probe probes sensor sensors",
        "snapshot().broken_at": "broken broken_at",
        "snapshot().strain": "strain strains",
        'readings, of a Probe([i, j], "tension") or Probe(group, "force")': (
            "tension tensions spring_force spring_forces forces force axial_force"
        ),
    },
    "Ensemble": {
        "step() and frame(), or run(duration, observe={...})": "frames",
        "simulation_of(k), which msdwarp.film, msdwarp.view and others take": (
            "film video show view render plot draw record"
        ),
        "run(duration, observe={...}), which observes probes and energies by world": (
            "readings measure probe probes tension force forces energy kinetic_energy elastic_energy"
        ),
        "frame().position": "x points qpos",
        "system_of(world), or simulation_of(world)": "snapshot system systems simulation world scene_of scene",
    },
    "Frame": {"position": "x q points positions pos", "velocity": "v velocities", "time": "t"},
    "FitResult": {"standard_deviations": "uncertainty uncertainties errors std stderr sigma"},
    "Modes": {"frequencies [Hz]": "omega omegas eigenvalues omega_n", "shapes": "vectors eigenvectors modes"},
}
"""What an unknown attribute may mean, by class or module: a text, and the guesses that lead to it."""
_NEAR = 0.7
"""How alike a guess and a name must be, of 1: a third of such letters may differ."""
_MOST_LISTED = 25
"""Maximal number of parameters that a message lists if none is near."""
_done = set[type]()
"""Classes that `guide` has changed."""
_UNEXPECTED = re.compile(r".*\(\) got an unexpected keyword argument '(\w+)'")


def did_you_mean(guess: str, known: Iterable[str], meant: dict[str, str] | None = None) -> str:
    """Return the end of a message that leads from a guess to a known name; empty if none is near."""
    for text, guesses in (meant or {}).items():
        if _plain(guess) in map(_plain, guesses.split()):
            return f". Did you mean {text}?"
    names = {_plain(name): name for name in known}
    near = difflib.get_close_matches(_plain(guess), names, 1, _NEAR)
    return f". Did you mean {names[near[0]]}?" if near else ""


def _plain(name: str) -> str:
    """Return a name without what differs between programs: set_gravity, setGravity and gravity are one."""
    plain = name.lower().replace("_", "")
    return plain[3:] if plain.startswith(("get", "set")) else plain


def parameter_meant(guess: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown keyword of a function with `known` parameters."""
    known = list(known)
    meant = {text: words for text, words in KEYWORDS.items() if re.split("[=,]", text)[0] in known}
    listed = f"; it takes {', '.join(known)}" if 0 < len(known) <= _MOST_LISTED else ""
    return did_you_mean(guess, known, meant) or listed


def no_attribute(of: Any, name: str, owner: str, what: str) -> AttributeError:
    """Return the error that an object has no attribute of this name; `what` is the object in the message."""
    hint = ""
    if not name.startswith("_"):  # Python asks for many of those, and takes the error for an answer
        known = getattr(of, "__all__", None) or [one for one in dir(of) if not one.startswith("_")]
        hint = did_you_mean(name, known, NAMES.get(owner))
    return AttributeError(f"{what} has no attribute {name!r}{hint}", name=name)


def guide(thing: Any) -> Any:
    """Return a public class or function whose errors lead from guessed names to its own.

    A class is changed in place: its constructor, its methods, and what says that there is no such attribute. Of a
    function another one is returned. Other objects, and exceptions, stay as they are.
    """
    if inspect.isfunction(thing):
        return _guided(thing)
    if not isinstance(thing, type) or issubclass(thing, BaseException):
        return thing
    for owner in thing.__mro__:
        if owner.__module__.startswith("msdwarp.") and owner not in _done:
            _done.add(owner)
            for name, member in list(vars(owner).items()):
                if inspect.isfunction(member) and (name == "__init__" or not name.startswith("_")):
                    setattr(owner, name, _guided(member))
    if not hasattr(thing, "__getattr__"):
        thing.__getattr__ = _missing  # type: ignore[attr-defined]
    return thing


def _guided(call: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that names the parameter which was meant, where a keyword is not one."""

    @functools.wraps(call)
    def guided(*given: Any, **named: Any) -> Any:
        try:
            return call(*given, **named)
        except BaseException as error:
            unseen(error)
            if type(error) is TypeError and (found := _UNEXPECTED.match(str(error))) and found[1] in named:
                error.args = _hinted(call, given, found[1], error) or error.args
            raise

    return guided


def _hinted(call: Callable[..., Any], given: tuple[Any, ...], word: str, error: TypeError) -> tuple[str] | None:
    """Return the arguments of an error about an unknown keyword, with the parameter that was meant.

    None if a function within `call` has raised the error, unless that is `replace`, whose keywords are fields.
    """
    if error.__traceback__ is None:  # Python itself could not make the call
        known = [
            one.name
            for one in inspect.signature(call).parameters.values()
            if one.kind is not one.VAR_KEYWORD and one.name != "self"
        ]
    elif call.__name__ == "replace":
        known = list(vars(given[0]))
    else:
        return None
    name = call.__name__ if call.__qualname__ == call.__name__ else f"{type(given[0]).__name__}.{call.__name__}"
    name = name.removesuffix(".__init__")
    return (f"{name}() got an unexpected keyword argument {word!r}{parameter_meant(word, known)}",)


def _missing(self: Any, name: str) -> Any:
    """Raise AttributeError, with the name that was meant."""
    if hasattr(type(self), name):  # a property, which raised this error itself
        return object.__getattribute__(self, name)
    owner = next((one.__name__ for one in type(self).__mro__ if one.__name__ in NAMES), "")
    raise no_attribute(self, name, owner, f"{type(self).__name__!r} object")

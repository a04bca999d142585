"""Blocks for contact_mechanics.py: a flat die slides on a pinned slab, a stack of dice rests, a block bounces."""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msdwarp import Contact, Plane, Simulation, SimulationDiverged, System, box

from ..common import METHODS
from .contact import CONSTANTS, FPS, G

SPACING, WIDE = 0.1, 0.2
"""Spacing of a die, and its width [m]."""
RESTITUTIONS = (0.05, 0.3, 1.0)
AFTER = 0.1
"""Motion counts from then on [s]: before, the die finds its overlap with the slab."""
MOVES = 0.05
"""Slower than this the die does not slide [m/s]."""
FIRST = (0.031, -0.107)
"""Where the die starts on the slab: from its end, and from its middle line [m]. No edges lie on each other."""
OFFSET = (0.021, -0.013)
"""By how much each die of a stack is moved beside the one below [m]."""


class Slide(NamedTuple):
    """A flat die on a pinned slab that leans."""

    angle: float
    """Slope [°]."""
    friction: float
    restitution: float
    spacing: float
    """Spacing of the slab [m]."""
    speed: float = 0.0
    """Speed at the start, downhill [m/s]."""
    seconds: float = 0.4
    both: bool = False
    """Whether symplectic Euler does it, too."""

    @property
    def coulomb(self) -> float:
        """The acceleration while it slides downhill, by Coulomb's law [m/s²]."""
        slope = math.radians(self.angle)
        return G * (math.sin(slope) - self.friction * math.cos(slope))

    @property
    def sticks(self) -> bool:
        """Whether it never moves, by Coulomb's law."""
        return self.speed == 0 and self.coulomb <= 0

    @property
    def way(self) -> float:
        """How far it slides, by Coulomb's law [m]."""
        if self.coulomb < 0:
            return min(self.speed**2 / (-2 * self.coulomb), self.speed * self.seconds)
        return self.speed * self.seconds + 0.5 * self.coulomb * self.seconds**2


SLIDES = [
    *(Slide(45, mu, e, 0.05, both=e > 0.05) for e, mu in itertools.product(RESTITUTIONS, (0.0, 0.2, 0.4, 0.8))),
    *(Slide(45, 0.4, e, spacing) for spacing, e in itertools.product((0.1, 0.2), RESTITUTIONS)),
    *(Slide(45, 0.4, e, 0.025, seconds=0.3) for e in RESTITUTIONS),
    Slide(45, 0.3, 0.05, 0.025, seconds=0.5),
    Slide(30, 0.0, 0.05, 0.05, seconds=0.5),
    Slide(60, 0.8, 0.3, 0.05),
    *(Slide(0, 0.3, e, 0.05, speed, both=e == 0.3) for e, speed in itertools.product(RESTITUTIONS, (1.5, 3, 5))),
    Slide(0, 0.0, 0.05, 0.05, 5),
    Slide(0, 0.3, 0.3, 0.2, 5),
    Slide(15, 0.5, 0.3, 0.05, seconds=0.8, both=True),
    Slide(30, 1.0, 0.05, 0.05, seconds=0.8),
    Slide(40, 1.0, 1.0, 0.05, seconds=0.8),
]
"""Sweeps over friction, spacing and speed with three restitutions; other slopes; three that stick."""


def down(angle: float) -> tuple[float, float, float]:
    """Return gravity on a slope [°] whose normal is z and that falls along x [m/s²]."""
    return (G * math.sin(math.radians(angle)), 0.0, -G * math.cos(math.radians(angle)))


def pinned_slab(length: float, width: float, spacing: float, **constants: Any) -> System:
    """Return a slab of two layers whose top is at z = 0 and begins at x = 0, its middle line at y = 0, pinned."""
    shape = (math.ceil(length / spacing) + 1, math.ceil(width / spacing) + 1, 2)
    slab = box(shape, spacing, **(constants or CONSTANTS))
    slab = slab.translate((-slab.position[:, 0].min(), 0.0, -slab.position[:, 2].max()))
    return slab.pin(np.arange(slab.particle_count))


def die_at(low: ArrayLike, layers: int = 3) -> System:
    """Return a die whose lowest corner is there [m]; with two layers it is half as high."""
    die = box((3, 3, layers), SPACING, **CONSTANTS)
    return die.translate(np.asarray(low) - die.position.min(axis=0))


def methods(both: bool) -> tuple[str, ...]:
    """Return the methods of a case: leapfrog, and symplectic Euler if it is measured with both."""
    return ("leapfrog", "symplectic Euler") if both else ("leapfrog",)


def advances(simulation: Simulation) -> bool:
    """Take a frame; print why, and return False, if the run diverges in it."""
    try:
        simulation.step()
    except SimulationDiverged as error:
        print(f"diverged: {str(error).splitlines()[0]}")
        return False
    return True


def motion(simulation: Simulation, seconds: float, particles: slice) -> tuple[NDArray, NDArray]:
    """Return positions and velocities of some particles after each frame, shape [frame_count, particle_count, 3].

    A run that diverges ends early.
    """
    kept = []
    for _ in range(round(seconds * simulation.fps)):
        if not advances(simulation):
            break
        frame = simulation.frame()
        kept.append((frame.position[particles], frame.velocity[particles]))
    if not kept:
        return np.zeros((2, 0, 1, 3))[0], np.zeros((0, 1, 3))
    x, v = np.array(kept, dtype=np.float64).swapaxes(0, 1)
    return x, v


def slope_of(t: NDArray, v: NDArray, chosen: NDArray) -> float:
    """Return the slope of a line through chosen values; nan if they are fewer than four."""
    return float(np.polyfit(t[chosen], v[chosen], 1)[0]) if chosen.sum() >= 4 else math.nan


def measure_sliding(options) -> list[dict]:
    """Return a row for each die that slides, or should stick."""
    rows = []
    for case in SLIDES[:3] if options.quick else SLIDES:
        for method in methods(case.both and not options.quick):
            rows.append(_row_of(case, method, options.device))
    return rows


def _row_of(case: Slide, method: str, device: str) -> dict:
    slab = pinned_slab(case.way + WIDE + 0.2, WIDE + 0.1, case.spacing)
    # Its edges are round, with a quarter of the spacing: a whole die would tip over from a friction of 0.75 on.
    die = die_at((*FIRST, 0.0), layers=2).with_velocity((case.speed, 0.0, 0.0))
    simulation = Simulation(
        slab + die,
        gravity=down(case.angle),
        contact=Contact(friction=case.friction, restitution=case.restitution),
        integrator=METHODS[method],
        device=device,
        fps=FPS,
    )
    substeps = simulation.substeps
    x, v = motion(simulation, case.seconds, slice(-die.particle_count, None))
    x, v, t = x[..., 0].mean(axis=1), v[..., 0].mean(axis=1), (np.arange(len(x)) + 1) / FPS
    counted = (t > AFTER) & ((v > MOVES) | case.sticks)
    acceleration = slope_of(t, v, counted)
    effective, last = math.nan, round(FPS * 0.25)
    if not case.sticks:
        slope = math.radians(case.angle)
        effective = (G * math.sin(slope) - acceleration) / (G * math.cos(slope))
    return {
        "method": method,
        "angle": case.angle,
        "friction": case.friction,
        "restitution": case.restitution,
        "spacing": case.spacing,
        "speed": case.speed,
        "substeps": substeps,
        "mean_speed": float(v[counted].mean()) if counted.any() else math.nan,  # while it slides [m/s]
        "coulomb": 0.0 if case.sticks else case.coulomb,  # [m/s²]
        "acceleration": acceleration,
        "effective": effective,
        "error": effective - case.friction,
        # Of a die that sticks: its speed over the last quarter of a second [m/s].
        "creep": abs(x[-1] - x[-1 - last]) / 0.25 if case.sticks and len(x) > last else math.nan,
    }


# --- A stack ---


def measure_stack(options) -> list[dict]:
    """Return a row for each ground and die at rest: the forces on its layers against the weights they carry."""
    rows = []
    for ground, method in itertools.product(("plane", "pinned slab"), methods(both=True)):
        low = np.array([*FIRST, 0.0])
        stack = [die_at(low + k * np.array([*OFFSET, WIDE])) for k in range(3)]
        dice = stack[0] + stack[1] + stack[2]
        slab = pinned_slab(0.5, 0.5, 0.05)
        on_plane = ground == "plane"
        simulation = Simulation(
            dice if on_plane else slab + dice,
            colliders=[Plane()] if on_plane else [],
            contact=Contact(),
            integrator=METHODS[method],
            device=options.device,
            fps=FPS,
            contact_forces=True,
        )
        simulation.step(30 if options.quick else 150)
        forces = []
        for _ in range(30):
            simulation.step()
            forces.append(simulation.contact_force()[-dice.particle_count :, 2])
        force = np.mean(forces, axis=0, dtype=np.float64).reshape(3, -1)
        weight = G * dice.mass.reshape(3, -1).sum(axis=1)
        for k in range(3):
            # What dice exert on each other cancels, so the rest is from below, on those from here on.
            lower, upper = force[k:].sum(), force[k + 1 :].sum()
            carried, above = weight[k:].sum(), weight[k + 1 :].sum()
            wrong = [lower / carried - 1, upper / above - 1 if k < 2 else 0.0, force[k].sum() / weight[k] - 1]
            rows.append(
                {
                    "ground": ground,
                    "method": method,
                    "die": k + 1,
                    "from_below": float(lower),  # [N]
                    "carried": float(carried),  # its weight and those above [N]
                    "from_above": float(upper),  # [N]
                    "above": float(above),  # the weights above [N]
                    "error": float(max(wrong, key=abs)),  # the largest, also that of all contact forces on it
                }
            )
    return rows


# --- A block that bounces ---

IMPACT = 0.2
"""Speed of the block [m/s]: so slow that even a soft contact stops its corner within the thickness."""
GAP, OFF = 0.015, (0.004, 0.003)
"""How far it starts above the pinned block, and beside its middle [m]: its lattice is not above that one's."""
BOUNCED = (0.05, 0.3, 0.7, 1.0)
"""Restitutions that are asked for."""
SOFTER = (100.0, 10.0, 1.0)
"""How many times as stiff as the contact the block's springs are; 1 without a stiffness in `Contact`."""
DAMPED = (0.0, 8.0)
"""Dampers of the block's springs [N s/m]."""
POSES = {"flat": (0.0, (1, 0, 0)), "edge": (45.0, (1, 0, 0)), "corner": (54.7356, (1, -1, 0))}
"""How the block lands: it is turned by this angle [°] about this axis."""


def measure_bounce(options) -> list[dict]:
    """Return a row for each block that flies at a pinned one: the speed with which it comes back."""
    cases = itertools.product(POSES, DAMPED, SOFTER, BOUNCED)
    return [_bounce(*case, options.device) for case in itertools.islice(cases, 2 if options.quick else None)]


def _bounce(pose: str, damping: float, softer: float, restitution: float, device: str) -> dict:
    stiffness, spacing, (angle, axis) = 2e4, 0.05, POSES[pose]
    constants = {"mass": 0.02, "stiffness": stiffness, "damping": damping}
    slab = pinned_slab(0.4, 0.4, spacing, **constants)
    block = box((4, 4, 4), spacing, **constants).rotate(math.radians(angle), axis)
    x, y = slab.position[:, :2].mean(axis=0) - block.position[:, :2].mean(axis=0) + OFF
    block = block.translate((x, y, GAP - block.position[:, 2].min()))
    simulation = Simulation(
        slab + block.with_velocity((0.0, 0.0, -IMPACT)),
        gravity=0.0,
        contact=Contact(
            friction=0.0, restitution=restitution, stiffness=None if softer == 1.0 else stiffness / softer
        ),
        precision="float64",
        device=device,
        fps=FPS,
    )
    substeps = simulation.substeps
    x, v = motion(simulation, 0.8 if softer == 100.0 else 0.4, slice(-block.particle_count, None))
    centre, arm = v[-1].mean(axis=0), x[-1] - x[-1].mean(axis=0)
    inertia = (arm**2).sum() * np.eye(3) - arm.T @ arm  # per mass of a particle
    turn = np.linalg.solve(inertia, np.cross(arm, v[-1]).sum(axis=0))
    energy = block.particle_count * centre @ centre + turn @ inertia @ turn
    return {
        "pose": pose,
        "damping": damping,
        "softer": softer,  # stiffness of the springs over that of the contact
        "restitution": restitution,
        "substeps": substeps,
        "measured": float(centre[2]) / IMPACT,  # speed of the centre after over before
        # By the energy of a rigid motion, with rotation, in place of the centre's:
        "with_rotation": math.sqrt(energy / block.particle_count) / IMPACT,
    }

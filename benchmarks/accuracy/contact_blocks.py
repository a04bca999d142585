"""Blocks for contact_mechanics.py: a die that slides on a pinned slab, and a stack of dice at rest."""

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
    """A die on a pinned slab that leans."""

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
"""Sweeps over friction, spacing and speed with three restitutions; other slopes; three that stick.

With a friction of 1 or more a die would tip over.
"""


def down(angle: float) -> tuple[float, float, float]:
    """Return gravity on a slope [°] whose normal is z and that falls along x [m/s²]."""
    return (G * math.sin(math.radians(angle)), 0.0, -G * math.cos(math.radians(angle)))


def pinned_slab(length: float, width: float, spacing: float, **constants: Any) -> System:
    """Return a slab of two layers whose top is at z = 0 and begins at x = 0, its middle line at y = 0, pinned."""
    shape = (math.ceil(length / spacing) + 1, math.ceil(width / spacing) + 1, 2)
    slab = box(shape, spacing, **(constants or CONSTANTS))
    slab = slab.translate((-slab.position[:, 0].min(), 0.0, -slab.position[:, 2].max()))
    return slab.pin(np.arange(slab.particle_count))


def die_at(low: ArrayLike) -> System:
    """Return a die whose lowest corner is there [m]."""
    die = box((3, 3, 3), SPACING, **CONSTANTS)
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
    die = die_at((*FIRST, 0.0)).with_velocity((case.speed, 0.0, 0.0))
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
        height = dice.position[:, 2].reshape(3, -1)
        weight = G * dice.mass.reshape(3, -1).sum(axis=1)
        for k in range(3):
            lower = force[k, height[k] < height[k].min() + 0.5 * SPACING].sum()
            upper = -force[k, height[k] > height[k].max() - 0.5 * SPACING].sum()
            carried, above = weight[k:].sum(), weight[k + 1 :].sum()
            wrong = [lower / carried - 1, upper / above - 1 if k < 2 else 0.0, force[k].sum() / weight[k] - 1]
            rows.append(
                {
                    "ground": ground,
                    "method": method,
                    "die": k + 1,
                    "from_below": float(lower),  # on its lower layer [N]
                    "carried": float(carried),  # its weight and those above [N]
                    "from_above": float(upper),  # on its upper layer [N]
                    "above": float(above),  # the weights above [N]
                    "error": float(max(wrong, key=abs)),  # the largest, also that of all contact forces on it
                }
            )
    return rows

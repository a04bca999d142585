"""Scene: a system with its surroundings and look; files in scenes/ build scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import counted, headline
from .colliders import Plane
from .drives import PrescribedMotion
from .gravity import gravity_in_words
from .loads import Force
from .look import OBLIQUE, Look
from .problem import Problem

Observed = Callable[[NDArray, NDArray], NDArray]
"""A function of positions and velocities of worlds, each of shape [worlds, particle_count, d]."""
ABOVE_GROUND = 5.0
"""Elevation of a camera before an upright plane [degrees], where there is ground to see: next to none."""
ROUNDING = 1e-9
"""What counts as no part of a vector along an axis, over its largest part: what rotations leave."""
_SHOWN = 3
"""Maximal number of colliders, and of loads, that a scene's text lists; if there are more, they are counted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene(Problem):
    """Bodies and their surroundings, the simulated time, and how to draw them.

    Parameters
    ----------
    system
        The bodies to simulate.
    colliders
        Obstacles. The fixed plane that is closest to horizontal and faces up is drawn as the ground.
    loads
        Loads on the bodies, such as `Force` or `Wind`, besides gravity and obstacles.
    contact
        Contact between bodies: a `Contact`, or several. By default bodies pass through each other.
    gravity
        Acceleration of free fall [m/s²]; it may be a function of time, see `Simulation`.
    duration
        Simulated time [s].
    look
        Look of the picture, and of all bodies that are not in `looks`.
    looks
        Looks of single bodies, or parts of them, by the name of their group (see `System.named`). They set the
        parameters of a body (see `Look`). A triangle is in a group if all its corners are, as for loads; a
        connection if one of its ends is. If two groups have some in common, the later look is used.
    schedule
        Changes at set times, made by `msdwarp.at`.
    probes
        Sensors by name: `{"foot": Probe("foot", "contact force")}`. `msdwarp run` writes their values to
        probes.csv, and the values read by substep to probes_by_substep.csv.
    observe
        Quantities to observe, by name: functions of positions and velocities, of shape [worlds, particle_count, d]
        each, that return an array with the worlds along the first axis. `Ensemble.run` observes them,
        `msdwarp run` prints them at the end, `msdwarp sweep` stores them.
    settled
        Whether a simulation starts from static equilibrium under the loads at the start: see `Simulation.settle`.
    shape
        Positions by which surfaces for contact are made [m], shape [particle_count, d], if the bodies start
        deformed, as by `Simulation.snapshot`; by default those of `system`.

    Raises
    ------
    ValueError
        If an argument has the wrong number of coordinates.
    """

    duration: float = 4.0
    look: Look = field(default_factory=Look)
    looks: Mapping[str, Look] = field(default_factory=dict)
    observe: Mapping[str, Observed] = field(default_factory=dict)
    settled: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.positive("duration", self.duration)
        checks.one_of("settled", self.settled, (False, True))
        checks.instance("look", self.look, Look, "Look(color='#d9603b')")
        if self.look.follow is not None:
            checks.one_of("look.follow", self.look.follow, self.system.groups)
        if (cut := self.look.cut) is not None:
            if (wrong := cut.fits(self.system.dim)) is not None:
                raise ValueError(f"look.cut: {wrong}")
            if (self.system.position @ cut.unit_normal(self.system.dim) > cut.offset).all():
                raise ValueError(
                    f"look.cut is {cut}, and all bodies are above it; it must leave something of them"
                )
        if None in (self.look.azimuth, self.look.elevation):
            azimuth, elevation = self.look.angles(self._front())
            object.__setattr__(self, "look", replace(self.look, azimuth=azimuth, elevation=elevation))
        object.__setattr__(self, "looks", self._checked_looks())
        object.__setattr__(self, "observe", dict(checks.mapping("observe", self.observe)))
        for name, one in self.observe.items():
            checks.instance("a name in observe", name, str, "'faces'")
            if not callable(one):
                raise ValueError(
                    f"observe[{name!r}] is {checks.repr_short(one)}; it must be a function (position, velocity)"
                )

    def _checked_looks(self) -> dict[str, Look]:
        """Return the looks of groups; raise ValueError for an unknown group, or a field of the whole picture."""
        looks = dict(checks.mapping("looks", self.looks))
        for name, look in looks.items():
            checks.one_of("a name in looks", name, self.system.groups)
            checks.instance(f"looks[{name!r}]", look, Look, "Look(color='#d9603b')")
            if wrong := look.of_the_picture():
                raise ValueError(
                    f"looks[{name!r}] sets {' and '.join(wrong)}, which is of the whole picture; it must be set "
                    "by the scene's look"
                )
        return looks

    def __repr__(self) -> str:
        gravity = gravity_in_words(self.gravity)
        lines = [f"Scene of {self.duration:.4g} s, gravity {gravity}", headline(self.system)]
        driven = [one for one in self.loads if isinstance(one, PrescribedMotion)]
        others = [one for one in self.loads if not isinstance(one, PrescribedMotion)]
        lines += _listed("colliders", self.colliders)
        lines += [f"looks of their own: {', '.join(self.looks)}"] if self.looks else []
        lines += _listed("driven", driven) + _listed("loads", others)
        if self.schedule:
            times = sorted(change.time for change in self.schedule)
            when = f"{times[0]:.4g} s" if len(times) == 1 else f"{times[0]:.4g} to {times[-1]:.4g} s"
            lines.append(f"schedule: {counted(len(times), 'change')}, at {when}")
        if self.probes:
            lines.append(f"probes: {', '.join(f'{name} {one!r}' for name, one in self.probes.items())}")
        return "\n  ".join(lines)

    def observed(self, position: NDArray, velocity: NDArray) -> dict[str, NDArray]:
        """Return the quantities of `observe` for one world; both arguments have shape [particle_count, d].

        Raises ValueError if a function does not return numbers with one world along the first axis.
        """
        now = position[None], velocity[None]
        return {name: observed_values(name, of, *now)[0] for name, of in self.observe.items()}

    def _front(self) -> tuple[float, float]:
        """Return the azimuth and elevation [degrees] from which a camera sees the scene by default.

        What lies in a plane and stays there is seen from its front: if the plane is level, from above.
        """
        flat = 1 if self.system.dim < 3 else self._flat_along()
        if flat is None:
            return OBLIQUE
        if flat == 2:
            return -90.0, 90.0
        return -90.0 if flat == 1 else 0.0, ABOVE_GROUND if self.ground else 0.0

    def _flat_along(self) -> int | None:
        """Return the axis across which all particles of a scene in space lie and stay in one plane; None if none.

        They stay in it if nothing that is known to be constant has a part along the axis: velocities, gravity,
        forces, normals of planes; and if other obstacles have their centres in the plane.
        """
        place, forces = self.system.position[0], [one for one in self.loads if isinstance(one, Force)]
        if len(forces) + len(self.contact_rules) < len(self.loads) or self.schedule:
            return None
        given = [self.gravity, *(one.force for one in forces)]
        if any(callable(one) for one in given):
            return None
        planes = [one.unit_normal(3) for one in self.colliders if isinstance(one, Plane)]
        solids = [one.center(3) for one in self.colliders if not isinstance(one, Plane)]
        points = np.concatenate([self.system.position, *np.reshape(solids, (-1, 1, 3))]) - place
        down = checks.gravity("gravity", self.gravity, 3)
        most = np.array([np.abs(one).max(axis=0) for one in (points, self.system.velocity)] + [*planes, down])
        most = np.abs(np.concatenate([most, np.reshape(given[1:], (-1, 3))]))
        moved = (most > ROUNDING * most.max(axis=1, keepdims=True)).any(axis=0)
        return next((k for k in (1, 2, 0) if not moved[k]), None)

    @property
    def ground(self) -> Plane | None:
        """The fixed plane that is closest to horizontal and faces up; None if there is none."""
        dim = self.system.dim
        planes = [one for one in self.colliders if isinstance(one, Plane) and one.motion is None]
        upwards = [plane for plane in planes if plane.unit_normal(dim)[-1] > 0]
        return max(upwards, key=lambda plane: plane.unit_normal(dim)[-1], default=None)


def observed_values(name: str, function: Any, position: NDArray, velocity: NDArray) -> NDArray:
    """Return what a function of `observe` returns for worlds, of shape [worlds, ...].

    Raises ValueError unless that is an array of numbers whose first axis is that of the worlds.
    """
    given = function(position, velocity)
    try:
        values = np.asarray(given)
    except ValueError:  # its rows differ in length
        values = np.asarray(None)
    if values.dtype.kind not in "biufc" or np.ma.is_masked(given):
        raise ValueError(f"observe[{name!r}] returned {checks.repr_short(given)}; it must be numbers in an array")
    if values.shape[:1] != position.shape[:1]:
        raise ValueError(
            f"observe[{name!r}] returned shape {values.shape}; the first axis must be that of the "
            f"{counted(len(position), 'world')}"
        )
    return values


def _listed(title: str, several: Sequence[object]) -> list[str]:
    """Return a line that shows the first of several objects; no line if there are none."""
    more = f" and {len(several) - _SHOWN} more" if len(several) > _SHOWN else ""
    return [f"{title}: {', '.join(map(repr, several[:_SHOWN]))}{more}"] if several else []

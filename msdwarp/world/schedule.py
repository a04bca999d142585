"""Changes of a system's parameters while it runs, at once or at set times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import System, particles_meant
from .drives import Driven
from .gravity import Gravity, gravity_at
from .loads import Load

OF_PARTICLES = ("mass", "velocity")
OF_CONNECTIONS = ("stiffness", "damping", "rest_length")


@dataclass(frozen=True, eq=False)
class Change:
    """New parameters from a given time on; the fields are as in `at`."""

    time: float = 0.0
    group: str | ArrayLike | None = None
    set_rest_shape: bool = False
    parameters: Mapping[str, Any] = field(default_factory=dict)
    unpin: str | ArrayLike | None = None
    gravity: Gravity | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", checks.non_negative("time", self.time))
        for name in self.parameters:
            if name in ("loads", "contact"):
                raise ValueError(
                    f"{name} is given to a schedule, which cannot hold it; "
                    f"simulation.change({name}=...) replaces it between two frames"
                )
            checks.one_of("parameter", name, (*OF_PARTICLES, *OF_CONNECTIONS, "gravity"))
        for name in ("group", "unpin", "gravity"):
            object.__setattr__(self, name, checks.as_now(getattr(self, name)))
        values = {name: checks.as_now(value) for name, value in self.parameters.items()}
        object.__setattr__(self, "parameters", values)
        checks.one_of("set_rest_shape", self.set_rest_shape, (False, True))
        if self.set_rest_shape and "rest_length" in self.parameters:
            raise ValueError(
                "set_rest_shape sets rest_length to the current lengths; rest_length cannot be given too"
            )

    @property
    def of_gravity_alone(self) -> bool:
        """Whether only gravity changes."""
        return self.gravity is not None and self.unpin is None and not self.parameters and not self.set_rest_shape

    @property
    def of_velocity_alone(self) -> bool:
        """Whether only velocities change."""
        others = self.set_rest_shape or self.unpin is not None or self.gravity is not None
        return not others and set(self.parameters) == {"velocity"}

    @property
    def foreseen(self) -> Change:
        """The change without a function of velocities, which are known only once the run is there."""
        known = {
            name: value for name, value in self.parameters.items() if name != "velocity" or not callable(value)
        }
        return self if len(known) == len(self.parameters) else replace(self, parameters=known)

    def is_due(self, frame_index: int, fps: float) -> bool:
        """Return whether the change is due after `frame_index` frames, with `fps` frames per second.

        It takes effect in the first frame that begins at its time or later; frame k begins at k / fps [s].
        """
        # Rounding of k / fps and of its product with fps changes k by up to 4e-16 k, less than the tolerance 1e-6
        # frames in a run of 10⁹ frames. Without this tolerance a change could be a frame late.
        return self.time * fps < frame_index + 1e-6

    def applied_to(self, system: System) -> System:
        """Return the system after the change; raise ValueError for an unknown group or a value out of range.

        A mass of inf pins a particle at its position, with velocity 0.
        """
        if self.gravity is not None:
            gravity_at(self.gravity, np.array([self.time]), system.dim)
        chosen, joined = self.chosen(system)
        values = {name: value for name, value in self.parameters.items() if name != "velocity"}
        if self.set_rest_shape:
            values["rest_length"] = system.length[joined]
        fields: dict[str, Any] = {}
        if self.set_rest_shape and system.cells is not None:
            fields["cells"] = system.cells.at_rest(system.position, chosen)
        for name, value in values.items():
            old = getattr(system, name)
            where = chosen if name in OF_PARTICLES else joined
            given: Any = value(old[where]) if callable(value) else value
            new = checks.array(name, given)
            fields[name] = new
            if not where.all():
                fields[name] = np.array(old)
                fields[name][where] = checks.broadcast(name, new, (int(where.sum()),))
        if "rest_length" in fields and not joined.all():  # other connections keep their plastic deformation
            fields["original_length"] = np.where(joined, fields["rest_length"], system.original_length)
        pinned = system.pinned
        if "mass" in fields:
            pinned = np.isinf(checks.broadcast("mass", fields["mass"], system.mass.shape))
            fields["velocity"] = np.where(pinned[:, None], 0.0, system.velocity)
        if "velocity" in self.parameters:
            before = fields.get("velocity", system.velocity)
            fields["velocity"] = self.velocities(system, before, pinned)
        return system.replace(**fields)

    def velocities(
        self, system: System, now: NDArray[np.floating], held: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return the velocities after the change [m/s], shape [particle_count, d].

        `now` are the velocities before the change, and `held` is the mask of pinned or driven particles, whose
        velocities stay. Raises ValueError if the group is unknown, all its particles are held, or a velocity is
        out of range.
        """
        chosen, value = self.particles(system), self.parameters["velocity"]
        if held[chosen].all():
            group = "all" if self.group is None else checks.repr_short(self.group)
            raise ValueError(f"velocity is given to group {group}, whose particles are all pinned or driven")
        result = np.array(now, dtype=np.float64)
        given: Any = value(result[chosen]) if callable(value) else value
        result[chosen] = checks.broadcast("velocity", given, (int(chosen.sum()), system.dim))
        checks.finite("velocity", result)
        result[held] = now[held]
        return result

    def released_from(self, loads: Sequence[Load], system: System) -> tuple[Load, ...]:
        """Return bound loads without drives on the particles `unpin`; raise ValueError if none is driven."""
        if self.unpin is None:
            return tuple(loads)
        free = particles_meant("unpin", self.unpin, system)
        if not any(isinstance(one, Driven) and free[one.held].any() for one in loads):
            name = f"unpin is {self.unpin!r}, which" if isinstance(self.unpin, str) else "unpin"
            raise ValueError(f"{name} names no particle that a drive holds then")
        return tuple(one.keeping(~free) if isinstance(one, Driven) else one for one in loads)

    def chosen(self, system: System) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return (mask of the group's particles, mask of the connections between them)."""
        chosen = self.particles(system)
        return chosen, np.all(chosen[system.connections], axis=1)

    def particles(self, system: System) -> NDArray[np.bool_]:
        """Return the mask of the group's particles, shape [particle_count]."""
        return particles_meant("group", self.group, system, some=False)


def at(
    time: float,
    *,
    group: str | ArrayLike | None = None,
    set_rest_shape: bool = False,
    pin: str | ArrayLike | None = None,
    unpin: str | ArrayLike | None = None,
    gravity: Gravity | None = None,
    **parameters: Any,
) -> Change:
    """Return a scheduled change, such as at(1.0, stiffness=300.0, group="scoop").

    Parameters
    ----------
    time
        Time of the change [s]; it takes effect with the first frame that begins at this time or later.
    group
        The name of a group of the system (see `System.named`), or particles (indices or a mask); also the
        connections between these particles. By default all.
    set_rest_shape
        Set rest lengths to the current lengths: the body keeps its current shape.
    pin
        Particles to pin where they then are: a group's name, indices or a mask. It is short for a mass of inf of
        that group, so that no group, and no parameters, can be given beside it.
    unpin
        Driven particles (see `PrescribedMotion`) to release: a group's name, indices or a mask. They move freely
        from their current velocity, with their own masses.
    gravity
        Acceleration of free fall [m/s²] of all particles from this time on; see `Simulation`.
    parameters
        mass [kg], stiffness [N/m], damping [N s/m], rest_length [m]: numbers, arrays for the group, or functions
        of the old values, such as rest_length=lambda length: 1.2 * length. Cells and angles keep their stiffness
        and damping. velocity [m/s]: a vector, one for each particle of the group, shape [n, d], or a function;
        velocities of pinned and driven particles stay. Functions are also tried when a simulation is made, except
        those of velocities.
    """
    if pin is not None:
        if group is not None or parameters or set_rest_shape:
            raise ValueError("pin is given beside other changes of a group; it must have a change of its own")
        group, parameters = pin, {"mass": np.inf}
    return Change(time, group, set_rest_shape, parameters, unpin, gravity)

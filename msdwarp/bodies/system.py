"""System: the simulated particles and connections, as NumPy arrays on the host."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .angles import Angles
from .cells import Cells
from .dampers import LINEAR, Damper
from .fields import DEFAULTS, TEARING_FIELDS, checked, lengths
from .numbering import between_neighbors, concatenated, renumbered
from .regions import Regional
from .selection import chosen, mask_of, particles_meant
from .space import rotation_matrix
from .springs import LINEAR_SPRING, Spring
from .surface import Surface
from .uniform import counted, span, stored, uniform

_NAMED = 4
"""Maximal number of groups that a system's text lists by name; if there are more, they are counted."""


@dataclass(frozen=True, eq=False, init=False)
class System(Regional):
    """Particles joined by connections, each a spring and a damper along its axis. Immutable.

    Scalars broadcast: `mass=0.1` is a tenth of a kilogram for every particle. All arrays are read-only;
    the methods return a new System.

    Parameters
    ----------
    position
        Particle positions [m], shape [particle_count, d] with d = 1, 2 or 3 coordinates. The last one
        points up.
    velocity
        Particle velocities [m/s], shape [particle_count, d].
    mass
        Particle masses [kg], shape [particle_count]; inf pins a particle.
    connections
        The two particles of each connection, shape [connection_count, 2].
    rest_length
        Length at which a spring exerts no force [m], shape [connection_count]; by default the initial length.
    stiffness
        Spring constants k [N/m], shape [connection_count].
    damping
        Damper constants b [N s/m], shape [connection_count].
    damper
        The law of all dampers, force against rate of lengthening, or `DamperKinds`; see `msdwarp.bodies.dampers`.
    spring
        The law of all springs, force against strain, or `SpringKinds`; see `msdwarp.bodies.springs`.
    yield_strain
        Strain beyond which a spring deforms permanently, shape [connection_count]; inf: never. See
        `msdwarp.kernels.springs.plasticity`.
    relaxation_time
        Time in which the excess strain falls to 1/e [s], shape [connection_count]; 0 yields at once.
    largest_plastic_strain
        Upper bound of |rest_length / original_length − 1|, below 1, shape [connection_count].
    original_length
        Rest length before any plastic deformation [m], shape [connection_count]; by default the rest length.
    break_strain
        Tensile strain beyond which a connection breaks, shape [connection_count]; inf: never. See
        `msdwarp.kernels.springs.fracture`.
    break_force
        Tension of the spring, stiffness · (length − rest_length), beyond which a connection breaks [N], shape
        [connection_count]; only for linear springs.
    broken_at
        Time at which each connection broke [s], shape [connection_count]; inf if unbroken. Broken connections
        exert no force and store no energy: broken_at=0 cuts them.
    surface
        The triangles that are drawn, if any.
    cells
        Cells that resist a change of their volume, if any.
    angles
        Triples of particles that resist bending, if any.
    directions
        Slices of the connections in each lattice direction by name, for each body in the system.
    groups
        Named groups of particles, indices of shape [any]; see `named`.

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, a mass or rest length is not positive, a stiffness or
        damping is negative, an index is out of range, a particle is connected with itself, a pinned particle
        moves, or a connection is longer at the start than its breaking length.
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    mass: NDArray[np.float64]
    connections: NDArray[np.int32]
    rest_length: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    damper: Damper
    spring: Spring
    yield_strain: NDArray[np.float64]
    relaxation_time: NDArray[np.float64]
    largest_plastic_strain: NDArray[np.float64]
    original_length: NDArray[np.float64]
    break_strain: NDArray[np.float64]
    break_force: NDArray[np.float64]
    broken_at: NDArray[np.float64]
    surface: Surface | None
    cells: Cells | None
    angles: Angles | None
    directions: tuple[Mapping[str, slice], ...]
    groups: Mapping[str, NDArray[np.int32]]

    def __init__(
        self,
        *,
        position: ArrayLike,
        velocity: ArrayLike = 0.0,
        mass: ArrayLike = 1.0,
        connections: ArrayLike = (),
        rest_length: ArrayLike | None = None,
        stiffness: ArrayLike = DEFAULTS["stiffness"],
        damping: ArrayLike = DEFAULTS["damping"],
        damper: Damper = LINEAR,
        spring: Spring = LINEAR_SPRING,
        yield_strain: ArrayLike = DEFAULTS["yield_strain"],
        relaxation_time: ArrayLike = DEFAULTS["relaxation_time"],
        largest_plastic_strain: ArrayLike = DEFAULTS["largest_plastic_strain"],
        original_length: ArrayLike | None = None,
        break_strain: ArrayLike = DEFAULTS["break_strain"],
        break_force: ArrayLike = DEFAULTS["break_force"],
        broken_at: ArrayLike = DEFAULTS["broken_at"],
        surface: Surface | None = None,
        cells: Cells | None = None,
        angles: Angles | None = None,
        directions: tuple[Mapping[str, slice], ...] = ({},),
        groups: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        given = {name: value for name, value in locals().items() if name != "self"}
        for name, value in checked(given).items():
            object.__setattr__(self, name, value)

    @classmethod
    def trusted(cls, **fields: Any) -> Self:
        """Return a system from valid fields, without checking, copying or broadcasting them.

        Fields must have their full shapes, as float64 or int32. Do not write to the arrays afterwards; they become
        read-only. position, connections and rest_length are required; others have the defaults of the class.
        """
        system = cls.__new__(cls)
        position, count = fields["position"], len(fields["connections"])
        defaults: dict[str, Any] = {name: uniform(value, count) for name, value in DEFAULTS.items()}
        defaults |= {"velocity": np.broadcast_to(0.0, position.shape), "mass": uniform(1.0, len(position))}
        defaults |= {"original_length": fields["rest_length"], "damper": LINEAR, "spring": LINEAR_SPRING}
        defaults |= {"surface": None, "cells": None, "angles": None, "directions": ({},), "groups": {}}
        for name, value in (defaults | fields).items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(system, name, value)
        return system

    def __repr__(self) -> str:
        low, high = self.position.min(axis=0), self.position.max(axis=0)
        extent = " × ".join(f"{edge:.4g}" for edge in high - low)
        corner = ", ".join(f"{edge:.4g}" for edge in low)
        pinned, broken = (int(np.count_nonzero(some)) for some in (self.pinned, self.broken))
        masses = [f"mass {self.mass[~self.pinned].sum():.4g} kg"] if pinned < self.particle_count else []
        masses += [f"{counted(pinned, 'particle')} pinned"] if pinned else []
        lines = [headline(self), f"extent {extent} m, lowest corner ({corner}) m", ", ".join(masses)]
        if self.connection_count:
            law = " N s/m" if self.damper == LINEAR else f" by {self.damper!r}"
            springs = f"stiffness {span(self.stiffness)} N/m, damping {span(self.damping)}{law}"
            springs += f", {self.spring!r}" if self.spring != LINEAR_SPRING else ""
            springs += f", yields beyond a strain of {span(self.yield_strain)}" if self.yields else ""
            tears = f", {counted(broken, 'connection')} broken" if broken else ", tears"
            lines.append(springs + (tears if self.tears else ""))
        if self.cells is not None:
            lines.append(f"{counted(len(self.cells), 'cell')}, modulus {span(self.cells.modulus)}")
        if self.angles is not None:
            lines.append(f"{counted(len(self.angles), 'angle')}, stiffness {span(self.angles.stiffness)} N m")
        if self.groups:
            groups = [f"{name} ({len(particles)})" for name, particles in list(self.groups.items())[:_NAMED]]
            more = f" and {len(self.groups) - _NAMED} more" if len(self.groups) > _NAMED else ""
            lines.append(f"groups: {', '.join(groups)}{more}")
        return "\n  ".join(lines)

    @property
    def particle_count(self) -> int:
        """Number of particles."""
        return len(self.position)

    @property
    def connection_count(self) -> int:
        """Number of connections."""
        return len(self.connections)

    @property
    def between_neighbors(self) -> NDArray[np.bool_] | None:
        """Mask that is False between second neighbours, shape [connection_count]; None if it would be all True.

        Second neighbours have directions such as "2x". Connections between them are compressed in a flat sheet:
        see `msdwarp.shapes.bending`.
        """
        return between_neighbors(self.directions, self.connection_count)

    @property
    def dim(self) -> int:
        """Number of coordinates of a particle: 1, 2 or 3."""
        return self.position.shape[1]

    @property
    def pinned(self) -> NDArray[np.bool_]:
        """Mask of the pinned particles, shape [particle_count]."""
        return np.isinf(self.mass)

    @property
    def yields(self) -> bool:
        """Whether any connection can deform permanently."""
        return bool(np.isfinite(stored(self.yield_strain)).any())

    @property
    def broken(self) -> NDArray[np.bool_]:
        """Mask of the broken connections, shape [connection_count]."""
        return np.isfinite(self.broken_at)

    @property
    def tears(self) -> bool:
        """Whether any connection can break, or is broken."""
        return any(np.isfinite(stored(getattr(self, name))).any() for name in TEARING_FIELDS)

    @property
    def length(self) -> NDArray[np.float64]:
        """Current length of each connection [m], shape [connection_count]."""
        return lengths(self.position, self.connections)

    @property
    def strain(self) -> NDArray[np.float64]:
        """Strain of each connection, length / rest_length − 1, shape [connection_count]."""
        return self.length / self.rest_length - 1

    @property
    def center_of_mass(self) -> NDArray[np.float64]:
        """Centre of mass of the free particles (of all, if all are pinned) [m], shape [d]."""
        weights = np.where(self.pinned, 0.0, self.mass)
        return np.average(self.position, axis=0, weights=weights if weights.any() else None)

    def direction(self, name: str, body: int = 0) -> slice:
        """Return the slice of a body's connections in one lattice direction, such as "x" or "x+y".

        Raises ValueError if there is no such body; KeyError, listing its directions, for an unknown direction.
        """
        checks.one_of("body", body, range(-len(self.directions), len(self.directions)))
        if name not in self.directions[body]:
            known = ", ".join(self.directions[body]) or "none"
            raise KeyError(f"direction {name!r} is unknown; body {body} has: {known}")
        return self.directions[body][name]

    def replace(self, **changes: Any) -> Self:
        """Return this system with some fields changed; the others are shared.

        New fields are checked, together with fields that must match them. A new rest length also replaces the
        original length, unless that is given. Stiffness and damping are those of springs: cells and angles keep
        theirs. Raises ValueError as the class does, TypeError for an unknown name.
        """
        known = vars(self)
        for name in changes:
            if name not in known:
                raise TypeError(f"System.replace() got an unexpected keyword argument {name!r}")
        if "rest_length" in changes:
            changes.setdefault("original_length", None)
        return self.trusted(**checked(changes, known))

    def translate(self, displacement: ArrayLike) -> Self:
        """Return this system moved by `displacement` [m], shape [d]."""
        return self.replace(position=self.position + checks.vector("displacement", displacement, self.dim))

    def rotate(self, angle: float, axis: ArrayLike = (0, 0, 1), about: ArrayLike | None = None) -> Self:
        """Return this system, with its velocities, rotated by `angle` [rad] about an axis.

        Raises ValueError if the system is one-dimensional, or the axis is zero.

        Parameters
        ----------
        angle
            Rotation angle [rad], counter-clockwise seen from the tip of the axis.
        axis
            Direction of the axis in three dimensions, of any length, shape [3]; unused in two.
        about
            A point on the axis [m], shape [d]; by default the centre of mass.
        """
        centre = self.center_of_mass if about is None else checks.broadcast("about", about, (self.dim,))
        turn = rotation_matrix(self.dim, angle, axis)
        return self.replace(position=(self.position - centre) @ turn.T + centre, velocity=self.velocity @ turn.T)

    def scale(self, factor: float, about: ArrayLike | None = None) -> Self:
        """Return this system with all lengths multiplied by a factor, about a point [m], shape [d].

        By default its centre of mass stays in place; scale(0.001, about=(0, 0, 0)) converts from millimetres.
        Masses, constants and velocities stay as they are: make a body of a material in its final size instead.
        """
        factor = checks.positive("factor", factor, checks.ONE_SIZE)
        centre = self.center_of_mass if about is None else checks.broadcast("about", about, (self.dim,))
        rest, original = (factor * one for one in (self.rest_length, self.original_length))
        cells, position = self.cells and self.cells.enlarged(factor), centre + factor * (self.position - centre)
        return self.replace(position=position, rest_length=rest, original_length=original, cells=cells)

    def spin(self, angular_velocity: ArrayLike) -> Self:
        """Return this system with a rotation about its centre of mass added to its velocities.

        The angular velocity [rad/s] has shape [3] in three dimensions, and is a scalar in two. Pinned particles
        stay at rest. Raises ValueError if the system is one-dimensional.
        """
        arm = self.position - self.center_of_mass
        if self.dim == 3:
            added = np.cross(checks.vector("angular_velocity", angular_velocity, 3), arm)
        elif self.dim == 2:
            omega = checks.broadcast("angular_velocity", angular_velocity, ())
            added = omega * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        else:
            raise ValueError("a one-dimensional system cannot spin")
        return self.with_velocity(self.velocity + added)

    def with_velocity(self, velocity: ArrayLike) -> Self:
        """Return this system with these velocities [m/s], shape [d] or [particle_count, d].

        Pinned particles stay at rest.
        """
        velocity = checks.broadcast("velocity", velocity, self.position.shape)
        pinned = self.pinned
        return self.replace(velocity=np.where(pinned[:, None], 0.0, velocity) if pinned.any() else velocity)

    def pin(self, selection: Any) -> Self:
        """Return this system with particles pinned.

        The selection is the name of a group, indices, a slice, or a mask of booleans, shape [particle_count].
        Raises ValueError if it is invalid or empty, no group has the name, or an index is out of range.
        """
        held = chosen("selection", selection, self)
        mass, velocity = np.array(self.mass), np.array(self.velocity)
        mass[held], velocity[held] = np.inf, 0.0
        return self.replace(mass=mass, velocity=velocity)

    def set_rest_shape(self) -> Self:
        """Return this system with every rest length set to the current length, so that it keeps its shape.

        The result has no plastic deformation. Rest volumes of cells become the current volumes.
        """
        cells = None if self.cells is None else self.cells.at_rest(self.position)
        return self.replace(rest_length=self.length, cells=cells)

    def named(self, name: str, which: Any = None) -> Self:
        """Return this system with particles in a group of this name, by default all; other groups stay.

        `which` is the name of another group, indices, a slice, a mask of booleans, shape [particle_count], or a
        function that returns one of these for the positions [m], such as lambda x: x[:, 2] < 0.1. Raises
        ValueError if it is invalid or empty.
        """
        checks.instance("name", name, str, "'scoop'")
        mask = particles_meant("which", which(self.position) if callable(which) else which, self)
        return self.replace(groups={**self.groups, name: np.flatnonzero(mask)})

    def group(self, name: str, argument: str = "group") -> NDArray[np.bool_]:
        """Return the mask of the particles in a group, shape [particle_count].

        Raises ValueError, naming the `argument` and listing the groups, if no group has this name.
        """
        checks.one_of(argument, name, self.groups)
        return mask_of(self.groups[name], self.particle_count)

    def renumbered(self, order: ArrayLike | None = None) -> Self:
        """Return this system with its particles in another order, and its connections ordered accordingly.

        Use it for meshes: a GPU is faster if connected particles are close in memory. Do not use it for a lattice:
        that would lose its directions, which make it fast. Particle `order[k]` becomes number k; by default the
        order is `space_filling_order(position)`. Raises ValueError if `order` is not a permutation.
        """
        return self.trusted(**renumbered(vars(self), order))

    def __len__(self) -> int:
        return self.particle_count

    def __radd__(self, other: int) -> Self:
        """Return this system for 0 + system, with which `sum` begins."""
        if other != 0:
            return NotImplemented
        return self

    def __add__(self, other: System) -> Self:
        """Return one system of both; the particles and connections of `other` come second."""
        if not isinstance(other, System):
            return NotImplemented
        return self.trusted(**concatenated(vars(self), vars(other)))


def headline(system: System) -> str:
    """Return the size of a system as a line of text."""
    particles = f"{counted(system.particle_count, 'particle')} in {counted(system.dim, 'dimension')}"
    return f"System of {particles}, {counted(system.connection_count, 'connection')}"

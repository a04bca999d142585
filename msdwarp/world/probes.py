"""Probes: measurements during a run, as by a tracker or a load cell.

`engine/diagnostics/probes.py` evaluates them, with the sums in `probes.py` and `spring_probes.py` of
`kernels/reductions`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import LINEAR_SPRING, NONE, System, particles_meant
from .colliders import Collider
from .contact import Contact
from .loads import Load

POSITION, VELOCITY, FORCE = "position", "velocity", "force"
STRAIN, TENSION, STRESS = "strain", "tension", "stress"
CONTACT_FORCE, BODY_CONTACT_FORCE = "contact force", "touch force"
UNITS = {POSITION: "m", VELOCITY: "m/s", **dict.fromkeys((FORCE, CONTACT_FORCE, BODY_CONTACT_FORCE), "N")}
UNITS |= {STRAIN: "", TENSION: "N", STRESS: "Pa"}
QUANTITIES = tuple(UNITS)
"""What probes measure on particles."""
WRENCH = "force and torque"
"""What they measure on an obstacle."""
UNITS[WRENCH] = "N and N m"
FRAME, SUBSTEP = "frame", "substep"


@dataclass(frozen=True, eq=False)
class Probe:
    """A sensor on a group of particles, or on an obstacle, read at the end of each frame or substep.

    `times, values = simulation.readings[name]` are its readings so far, values of shape [readings, components].

    Parameters
    ----------
    on
        The group: a name (see `System.named`), indices, or a mask. Or one of the scene's colliders: then the probe
        measures the force [N] of bodies on it, and their torque [N m] about the obstacle's centre (the point about
        which `motion` turns it), as components of one vector, averaged like the contact force below. In two
        dimensions the torque is one number, in one dimension there is none. The force of a particle in a corner is
        divided between the obstacles there along their normals. Torques are those of the particles' places at the
        end of the frame.
    what
        The measured quantity; nothing for an obstacle. Of a group:

        - "position" [m] and "velocity" [m/s]: means over the group, weighted by mass. Pinned and driven particles
          are ignored, unless the group has no others; then all have equal weight.
        - "force" [N]: the sum of the forces of connections, loads, other bodies and gravity on the group at the
          end of the frame. Forces within the group cancel. For a support (a pinned or driven group without
          weight) it is the reading of a load cell under the support. For a free group it is mass times the
          acceleration without obstacles.
        - "contact force" [N]: the force of obstacles and other bodies on the group, averaged over the frame: the
          sum of all contact impulses, divided by the frame's duration. The impulse of an obstacle is m (v' − v),
          and 0 for pinned and driven particles. The impulse of another body is ∫ f dt as the integrator computes
          it.
        - "touch force" [N]: the part of the contact force that comes from other bodies. Forces between two bodies
          of the group cancel.
        - "strain": the mean of length / rest length − 1 over the unbroken connections within the group, and the
          largest absolute strain.
        - "tension" [N]: the mean force along the unbroken connections within the group, positive in tension and
          negative in compression, and the largest absolute one. It is the force of the spring's law at its strain,
          and of its damper at its rate; muscles (`Actuator`) have their rest length of the moment. Of one spring,
          rope or rod: `Probe([4, 7], "tension")`, by the particles that it joins.
        - "stress" [Pa]: the volume-weighted mean Cauchy stress of the cells within the group, as components xx,
          yy, zz, xy, xz, yz, and the von Mises stress of this mean. A `Material` with a Poisson's ratio has cells;
          see `stress` for the formula. In sheets it is in N/m, in the plane of each cell.
    every
        "frame" reads at the end of each frame, "substep" at the end of each substep. With "substep" the contact
        force is averaged over the substep, and other forces are evaluated at its end. At substeps within a frame
        `Leapfrog` has the velocity of driven particles to first order only. Each substep needs a kernel launch for
        the sums: for small bodies, which otherwise need one launch per frame, these launches take longer than the
        substeps.
    """

    on: Any
    what: str = WRENCH
    every: str = FRAME

    def __post_init__(self) -> None:
        if isinstance(self.on, Collider) and self.what != WRENCH:
            raise ValueError(f"what is {self.what!r}; it must be left out for an obstacle: both are measured")
        if self.what == WRENCH and not isinstance(self.on, Collider):
            raise ValueError(
                f"what is left out, or {WRENCH!r}; for a group, here {checks.repr_short(self.on)}, it must be one "
                f"of {', '.join(map(repr, QUANTITIES))}: only an obstacle needs none"
            )
        checks.one_of("what", self.what, (WRENCH,) if isinstance(self.on, Collider) else QUANTITIES)
        checks.one_of("every", self.every, (FRAME, SUBSTEP))

    def __repr__(self) -> str:
        on = repr(self.on) if isinstance(self.on, str | Collider) else "particles"
        what = "" if self.what == WRENCH else f", {self.what!r}"
        return f"Probe({on}{what}{', every=' + repr(SUBSTEP) if self.every == SUBSTEP else ''})"

    def particles(self, system: System) -> NDArray[np.bool_]:
        """Return a mask of the group's particles, shape [particle_count]; raise ValueError if it is empty."""
        return particles_meant("on", self.on, system)

    def connections(self, system: System) -> NDArray[np.int64]:
        """Return the indices of connections within the group."""
        return np.flatnonzero(self.particles(system)[system.connections].all(axis=1))

    def cells(self, system: System) -> NDArray[np.bool_]:
        """Return a mask of cells with all corners in the group, shape [cell_count]; the system must have cells."""
        assert system.cells is not None
        corners = system.cells.corners
        return (self.particles(system)[corners] | (corners == NONE)).all(axis=1)

    def columns(self, dim: int) -> list[str]:
        """Return the column names of the probe's readings, such as "contact_force_x_N"."""
        if self.what == STRAIN:
            return ["strain_mean", "strain_largest"]
        if self.what == TENSION:
            return ["tension_mean_N", "tension_largest_N"]
        if self.what == WRENCH:
            torque = {1: [], 2: ["torque_N_m"], 3: [f"torque_{axis}_N_m" for axis in "xyz"]}[dim]
            return [f"force_{axis}_N" for axis in "xyz"[:dim]] + torque
        if self.what == STRESS:
            components = ("xx", "yy", "zz", "xy", "xz", "yz") if dim == 3 else ("xx", "yy", "xy")
            return [f"stress_{name}" for name in (*components, "von_mises")]
        unit = UNITS[self.what].replace("/", "_")
        return [f"{self.what.replace(' ', '_')}_{axis}_{unit}" for axis in "xyz"[:dim]]

    def check(self, system: System, colliders: Sequence[Collider], touches: bool) -> None:
        """Raise ValueError if the probe cannot measure this system."""
        if self.what == WRENCH:
            if not any(one is self.on for one in colliders):
                raise ValueError(f"on is {self.on!r}; it must be one of the scene's colliders, the same object")
            return
        self.particles(system)
        if self.what in (STRAIN, TENSION) and not len(self.connections(system)):
            raise ValueError(
                f"on is {checks.repr_short(self.on)}; for the {self.what} it must contain a connection, that is "
                "both of its particles"
            )
        if self.what == STRESS:
            if system.cells is None or not self.cells(system).any():
                raise ValueError(
                    f"on is {checks.repr_short(self.on)}; for the stress it must contain a cell: give the body "
                    "a Material with poissons_ratio"
                )
            if system.spring != LINEAR_SPRING:
                raise ValueError(f"what is {self.what!r}; springs must be linear then, not {system.spring!r}")
        if self.what == CONTACT_FORCE and not colliders and not touches:
            raise ValueError(
                f"what is {self.what!r}; there must be colliders then, that may touch the group, or bodies that "
                "touch (contact=Contact())"
            )
        if self.what == BODY_CONTACT_FORCE and not touches:
            raise ValueError(f"what is {self.what!r}; bodies must touch then (contact=Contact())")


def checked_probes(
    probes: object, system: System, colliders: Sequence[Collider], loads: Sequence[Load] = ()
) -> dict[str, Probe]:
    """Return probes by name; raise ValueError, naming the probe, if one cannot measure this system."""
    named = dict(checks.mapping("probes", probes))
    touches = any(isinstance(one, Contact) for one in loads)
    for name, one in named.items():
        checks.instance("a name in probes", name, str, "'foot'")
        checks.instance(f"probes[{name!r}]", one, Probe, "Probe('foot', 'force')")
        try:
            one.check(system, colliders, touches)
        except ValueError as error:
            raise ValueError(f"probes[{name!r}].{error}") from error
    return named


def probes_by(every: str, probes: Mapping[str, Probe]) -> dict[str, Probe]:
    """Return the probes that are read at this rate: "frame" or "substep"."""
    return {name: one for name, one in probes.items() if one.every == every}


def probe_columns(probes: Mapping[str, Probe], dim: int) -> list[str]:
    """Return the column names of several probes, one probe after the other."""
    return [f"{name}_{column}" for name, one in probes.items() for column in one.columns(dim)]

"""Warnings about tunnelling: contacts that may come out on the wrong side, and remedies.

`division_planes.py` is what prevents crossing, where one of the two bodies is open.
"""

import math
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...bodies import System, TouchingSurfaces
from ...kernels.collision import FACET, GAP, PLACE, POINT, SPEED
from .contact_rules import ContactRules
from .contact_surfaces import ContactSurfaces


class Tunnelling(NamedTuple):
    """A contact between a point of one body and a facet of another that may come out on the wrong side."""

    bodies: tuple[int, int]
    """Bodies of the point and of the facet."""
    place: NDArray[np.float64]
    """Position [m], shape [3]."""
    deep: float
    """Depth of the point [m]."""
    most: float
    """Largest depth from which it is pushed out [m]."""
    speed: float
    """Speed of approach [m/s]."""
    stiffness: float
    """Contact stiffness of the two bodies [N/m]."""
    closed: bool
    """Whether the facet's body has an inside."""

    @classmethod
    def of(cls, noted: NDArray[np.float64], surfaces: ContactSurfaces, rules: ContactRules) -> Self:
        """Return the contact that `kernels.collision.history` recorded in a frame, by indices in one world."""
        on_host = surfaces.on_host
        a, b = int(surfaces.body_of_point[int(noted[POINT])]), int(surfaces.body_of_facet[int(noted[FACET])])
        thickness, closed = float(rules.thickness[rules.between(a, b)]), bool(on_host.closed[b]) and a != b
        if thickness < 0:
            thickness = float(on_host.radius[a] + on_host.radius[b])
        most = max(thickness, float(surfaces.depth[0][b])) if closed else thickness
        stiffness = float(rules.pair_stiffness(a, b, on_host.stiffness[a], on_host.stiffness[b]))
        gap, speed = float(noted[GAP]), float(noted[SPEED])
        return cls((a, b), noted[PLACE:], -gap if closed else thickness - gap, most, speed, stiffness, closed)

    def described(self, system: System, surfaces: TouchingSurfaces, substeps: int, dt: float) -> str:
        """Return a warning: bodies, position, depth, speed, and remedies."""
        a, b = (_named(system, surfaces, body) for body in self.bodies)
        where = ", ".join(f"{one:.3g}" for one in self.place)
        way = self.speed * dt
        stiffer = f"Contact(stiffness=...) above the current {self.stiffness:.3g} N/m"
        if self.most == 0:  # at any speed
            helps = stiffer
        elif way > 0.5 * self.most:  # it moves too far in one substep, whatever the force
            needed = math.ceil(substeps * way / (0.5 * self.most))
            helps = f"substeps={needed} or more (in one of the current {substeps} it moves {way:.2g} m), {stiffer}"
        else:
            helps = f"{stiffer}, more than {substeps} substeps"
        reach = "points are pushed out of it up to a depth of" if self.closed else "contact acts up to a depth of"
        return (
            f"a point of {a} goes {self.deep:.3g} m deep into {b} near ({where}) m, at {self.speed:.3g} m/s; "
            f"{reach} {self.most:.3g} m, so that it may come out on the wrong side; remedies: {helps}, "
            "or a larger Contact(thickness=...)"
        )


def _named(system: System, surfaces: TouchingSurfaces, body: int) -> str:
    """Return a name for a body: the group that holds exactly its particles, else its first particle."""
    own = surfaces.body_of_particle == body
    for name in system.groups:
        if np.array_equal(system.group(name), own):
            return repr(name)
    return f"the body of particle {int(np.argmax(own))}"

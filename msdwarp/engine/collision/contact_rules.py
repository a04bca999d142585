"""ContactRules: the rule of each pair of bodies, contact stiffness, and contributions to the stability bound."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces, facet_moments
from ...world import Contact
from ..model.model import Model
from .contact_surfaces import ContactSurfaces
from .tables_by_world import Repeated

CONTACTS_OF_A_SPHERE = 32.0
"""Assumed number of simultaneous contacts of a single particle, in the stability bound.

About 6 would suffice for stability. This value requires more than twice the substeps. So the
restitution of a pair is within 2 % of the given one for most times of impact in a substep, always within 3 %.
"""
CONTACTS_OF_A_ROPE = 4.0
"""Assumed number of simultaneous contacts of a particle that is connected to others, as in a rope."""
NOTHING = 1e-30
"""Stands for the spacing of a body without one, such as a single particle [m]."""
UNITS = 2.0**-40
"""Unit in which forces or impulses are summed, as a fraction of the largest expected at a contact."""


def unit_of_sums(largest: float) -> float:
    """Return the unit of integer sums for a largest value; a power of 2, so that dividing by it is exact."""
    return 2.0 ** float(np.floor(np.log2(max(largest * UNITS, 1e-99))))


class ContactRules:
    """Contact rules by pairs of kinds of bodies; bodies in the same groups are of one kind.

    If several rules apply to a pair, the last one counts. `table` has the rule's index for two kinds, −1 if none
    applies; `kind` has the kind of each body. `thickness` [m] and `stiffness` [N/m] of a rule are −1 if not given.
    """

    def __init__(self, model: Model, surfaces: TouchingSurfaces, rules: Sequence[Contact]) -> None:
        self._rules = rules
        given = np.array([(one.thickness, one.stiffness) for one in rules], dtype=float)  # None becomes NaN
        self.thickness, self.stiffness = np.nan_to_num(given, nan=-1.0).T
        bodies, body = len(surfaces.solid), surfaces.body_of_particle
        names = sorted({name for one in rules for name in one.groups or ()})
        within = np.zeros((bodies, len(names)), dtype=bool)
        count = np.bincount(body, minlength=bodies)
        for k, name in enumerate(names):
            held = np.bincount(body[model.system.group(name)], minlength=bodies)
            if ((held > 0) & (held < count)).any():
                raise ValueError(
                    f"contact.groups names {name!r}, which holds a part of a body; it must hold whole ones"
                )
            within[:, k] = held > 0
        still = np.bincount(body[~np.isfinite(model.mass) & ~model.driven], minlength=bodies) == count
        kinds, kind = np.unique(np.column_stack([within, still]), axis=0, return_inverse=True)
        self.restitution = [one.restitution for one in rules]
        self.kind, self.table = kind.reshape(-1).astype(np.int32), np.full([len(kinds)] * 2, -1, dtype=np.int32)
        for number, one in enumerate(rules):
            value = -1 if one.exclude else number
            if one.groups is None:
                self.table[:] = value
                continue
            a, b = (kinds[:, names.index(name)] for name in one.groups)
            self.table[np.outer(a, b) | np.outer(b, a)] = value
        self.table[
            np.outer(kinds[:, -1], kinds[:, -1])
        ] = -1  # what is pinned as a whole presses on nothing like it

    def upload(self, data: Any, model: Model, each: Repeated) -> None:
        """Fill the struct that kernels read."""
        data.kind = each.alike(self.kind, int)
        for name, values, dtype in (
            ("table", self.table, int),
            ("self_contact", [int(one.self_contact) for one in self._rules], int),
            ("friction", [one.friction for one in self._rules], model.scalar),
            ("damping", [one.damping_ratio for one in self._rules], model.scalar),
            ("hysteresis", [one.hysteresis for one in self._rules], model.scalar),
            ("thickness", self.thickness, model.scalar),
            ("stiffness", self.stiffness, model.scalar),
        ):
            setattr(data, name, wp.array(values, dtype=dtype, device=model.device))

    def between(self, a: Any, b: Any) -> NDArray[np.int32]:
        """Return the indices of the rules between bodies a and b; −1 if they pass through each other."""
        return self.table[self.kind[a], self.kind[b]]

    def given_stiffness(self, a: Any, b: Any) -> NDArray[np.float64]:
        """Return the stiffness that rules give for contacts between bodies a and b [N/m]; −1 if none is given."""
        return np.append(self.stiffness, -1.0)[self.between(a, b)]

    def pair_stiffness(self, a: Any, b: Any, own_a: Any, own_b: Any) -> NDArray[np.float64]:
        """Return the stiffness of contacts of bodies a and b [N/m]: the rule's, or the harmonic mean of theirs."""
        given = self.given_stiffness(a, b)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(given < 0, harmonic_mean(own_a, own_b), given)

    def check(self, surfaces: TouchingSurfaces) -> None:
        """Raise ValueError for bodies without stiffness if no rule gives one, and for particles without a size."""
        soft = surfaces.stiffness <= 0
        for number, one in enumerate(self._rules):
            meant = (self.table == number).any(axis=1)[self.kind]
            if one.stiffness is None and (soft & meant).any():
                raise ValueError(
                    f"contact.stiffness is None, but {int((soft & meant).sum())} of the bodies have no "
                    "connections to take it from; it must be a number [N/m]"
                )
            grains = np.bincount(self.kind[(surfaces.spacing == 0) & meant], minlength=len(self.table))
            several = (self.table == number) & np.minimum.outer(grains, grains).astype(bool)
            np.fill_diagonal(several, np.diag(several) & (grains > 1))
            if one.thickness is None and several.any():
                raise ValueError(
                    f"contact.thickness is None, but {int(grains.sum())} of the bodies are single particles, "
                    "which have no size; it must be the distance at which they touch [m]"
                )

    def hops(self, surfaces: TouchingSurfaces) -> NDArray[np.int64]:
        """Return the number of edges around a vertex within which self-contact is off, shape [body_count]."""
        own = self.table[self.kind, self.kind]
        thickness = np.where(self.thickness[own] < 0, 2.0 * surfaces.radius, self.thickness[own])
        within = np.array([one.self_contact for one in self._rules])[own] & (own >= 0)
        hops = np.zeros(len(own), dtype=np.int64)
        wide = within & (surfaces.spacing > 0)
        hops[wide] = 1.5 * thickness[wide] / surfaces.spacing[wide]
        return hops

    def blocks(self, surfaces: ContactSurfaces) -> NDArray[np.float64]:
        """Return contributions to diagonal blocks of K [N/m], shape [rows, particle_count]."""
        return np.array([self._blocks(one, surfaces.around, surfaces.shape) for one in surfaces.by_row])

    def _blocks(
        self, surfaces: TouchingSurfaces, around: NDArray[np.float64], x: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return `blocks` for one row of the model's parameters; `around` is that of `ContactSurfaces`.

        A contact of stiffness k and gradient g has the stiffness matrix k g gᵀ. By Gershgorin's theorem it is
        bounded by the diagonal matrix of k |g_i| Σ|g_j|, with Σ|g_j| = 2: the weights of the point sum to 1, as do
        those of the facet. Half of that is returned, since the stability bound doubles blocks. All points of a
        surface are assumed to be in contact, with equally many points of other bodies.
        """
        bodies = len(surfaces.solid)
        own, spacing = surfaces.stiffness, np.maximum(surfaces.spacing, NOTHING)
        stiff, reaction = (np.zeros(bodies) for _ in range(2))
        # Equal bodies of the same kind count once.
        table = np.stack([self.kind, own, spacing, surfaces.solid], axis=1)
        alike, number = np.unique(table, axis=0, return_inverse=True)
        number = number.reshape(-1)
        for a, (kind_a, k_a, s_a, _) in enumerate(alike):
            most = opposite = 0.0
            for kind_b, k_b, s_b, _ in alike:
                which = self.table[int(kind_a), int(kind_b)]
                if which < 0:
                    continue
                one = self._rules[which]
                k = one.stiffness if one.stiffness is not None else harmonic_mean(k_a, k_b)
                # From spacings follow the other body's points per point here; grains are a thickness apart.
                apart = s_b if s_b > NOTHING else (one.thickness or s_a)
                most, opposite = max(most, k), max(opposite, k * max(1.0, (s_a / apart) ** 2))
            mine = number == a
            stiff[mine], reaction[mine] = most, opposite
        body = surfaces.body
        bare = np.bincount(body[surfaces.corner[:, 0]], minlength=bodies) > 0
        bare &= ~surfaces.solid & (surfaces.radius > 0.2 * spacing)
        contacts = np.where(surfaces.spacing == 0, CONTACTS_OF_A_SPHERE, np.where(bare, CONTACTS_OF_A_ROPE, 1.0))
        each = contacts[body] * (stiff + reaction)[body] * around
        # Not all vertices around a particle inside press along one axis at a time. Those on faces press along
        # these. So do the others if pressed by the same plane: of a cube's centre a third by its faces, half with
        # its edges.
        summed = spread_to_particles(surfaces, each, len(surfaces.body_of_particle))
        along = spread_to_particles(surfaces, each[:, None, None] * _directions(surfaces, x), len(summed))
        return 0.5 * (summed + np.linalg.eigvalsh(along)[:, -1])


def harmonic_mean(a: Any, b: Any) -> Any:
    """Return 2ab/(a + b), the stiffness of a contact between bodies of stiffness a and b [N/m]."""
    return 2 * a * b / (a + b)


def _directions(surfaces: TouchingSurfaces, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for vertices at x [m] the mean of n nᵀ over the triangles around each; the identity without any."""
    outer, _, total = facet_moments(x, surfaces.corner)
    bare = (total == 0)[:, None, None]
    return np.where(bare, np.eye(3), outer / np.where(bare, 1.0, total[:, None, None]))


def spread_to_particles(
    surfaces: TouchingSurfaces, values: NDArray[np.float64], particle_count: int
) -> NDArray[np.float64]:
    """Return for each particle the sum over vertices of their values times its absolute weights in them."""
    total = np.zeros((particle_count, *values.shape[1:]))
    for k in range(surfaces.particle.shape[1]):
        np.add.at(total, surfaces.particle[:, k], (np.abs(surfaces.weight[:, k]) * values.T).T)
    return total

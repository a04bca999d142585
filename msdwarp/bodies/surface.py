"""Surface: the triangles to draw, and the particles that move their vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks

_SUM = 1e-9
"""Tolerance for the sum of a vertex's weights, which is 1; rounding errors are far smaller."""


@dataclass(frozen=True, eq=False, init=False)
class Surface:
    """The triangles that are drawn, with separate vertices, so that edges and textures can be sharp.

    A vertex is either a particle or a weighted mean of k particles, Σ weight · position. Since the weights sum to
    1, vertices follow every affine motion of the particles: translation, rotation, stretching.

    Parameters
    ----------
    particle
        The particle of each vertex, shape [vertex_count]; or the k particles of each weighted mean, shape
        [vertex_count, k].
    weights
        The weights of the k particles, shape [vertex_count, k]: each row sums to 1; entries below 0 or above 1
        extrapolate. None if each vertex is a particle.
    uv
        Texture coordinates in 0 … 1, shape [vertex_count, 2].
    triangles
        Vertices of each triangle, counter-clockwise seen from outside, shape [triangle_count, 3].
    normal_of
        The vertex whose normal each vertex uses, shape [vertex_count]; it is averaged over the triangles around
        all vertices that share it. So a texture can have a seam where the surface is smooth. None: each vertex
        uses its own normal.

    Raises
    ------
    ValueError
        If an array has the wrong shape or an index is out of range, weights are missing, not finite or do not sum
        to 1, or `normal_of` has chains.
    """

    particle: NDArray[np.int32]
    weights: NDArray[np.float64] | None
    uv: NDArray[np.float64]
    triangles: NDArray[np.int32]
    normal_of: NDArray[np.int32] | None

    def __init__(
        self,
        *,
        particle: ArrayLike,
        uv: ArrayLike,
        triangles: ArrayLike,
        weights: ArrayLike | None = None,
        normal_of: ArrayLike | None = None,
    ) -> None:
        allowed = "(vertex_count,) or (vertex_count, k)"
        own = checks.whole_numbers("particle", particle, allowed, lambda s: len(s) in (1, 2) and s[1:] != (0,))
        checks.within("particle", own, checks.index_below(2**31 - 1))
        object.__setattr__(self, "particle", checks.as_int32(own))
        object.__setattr__(self, "weights", _checked_weights(weights, own.shape))
        object.__setattr__(self, "uv", checks.broadcast("uv", uv, (len(own), 2)))
        object.__setattr__(self, "triangles", checks.indices("triangles", triangles, 3, len(own)))
        object.__setattr__(self, "normal_of", None)
        if normal_of is not None:
            of = checks.whole_numbers("normal_of", normal_of, f"({len(own)},)", lambda s: s == own.shape[:1])
            checks.within("normal_of", of, checks.index_below(len(own)))
            checks.every("normal_of", of, of[of] == of, "a vertex that takes its own normal")
            object.__setattr__(self, "normal_of", checks.as_int32(of))

    def __repr__(self) -> str:
        return f"Surface of {len(self.particle)} vertices, {len(self.triangles)} triangles"

    def points(self, position: ArrayLike) -> NDArray[np.float64]:
        """Return the positions of the vertices [m], shape [vertex_count, d], for particles at `position` [m]."""
        x = np.asarray(position, dtype=np.float64)
        if x.ndim != 2:
            raise ValueError(f"position has shape {x.shape}; it must be (particle_count, d)")
        checks.within("particle", self.particle, checks.index_below(len(x)))
        if self.weights is None:
            return x[self.particle]
        return np.einsum("vk,vkd->vd", self.weights, x[self.particle])

    def triangles_in(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which triangles have all corners among chosen particles, a mask of shape [particle_count]."""
        particle, weights = self.mixture
        return (chosen[particle] | (weights == 0)).all(axis=1)[self.triangles].all(axis=1)

    def behind(self, first: Surface | None, particles: int) -> Surface:
        """Return `first`, if any, and this surface, with particle indices increased by `particles`, as one."""
        own = replace(self, particle=self.particle + np.int32(particles))
        if first is None:
            return own
        both, vertices = (first, own), len(first.particle)
        weights = normal_of = None
        particle = [each.particle for each in both]
        if any(each.weights is not None for each in both):
            width = max(each.mixture[0].shape[1] for each in both)
            particle, weights = zip(*(_widened(*each.mixture, width) for each in both), strict=True)
        if any(each.normal_of is not None for each in both):
            normal_of = np.concatenate([first._normals_of, own._normals_of + np.int32(vertices)])
        return Surface(
            particle=np.concatenate(particle),
            weights=None if weights is None else np.concatenate(weights),
            uv=np.concatenate([first.uv, own.uv]),
            triangles=np.concatenate([first.triangles, own.triangles + np.int32(vertices)]),
            normal_of=normal_of,
        )

    @property
    def mixture(self) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Particles and weights of each vertex, both of shape [vertex_count, k]."""
        if self.weights is None:
            return self.particle[:, None], np.ones((len(self.particle), 1))
        return self.particle, self.weights

    @property
    def particle_alone(self) -> NDArray[np.int32]:
        """The particle that each vertex is, −1 if it is a mean of several, shape [vertex_count].

        Bodies keep this beside others: a vertex that is a particle has it k times where others are means of k.
        """
        own = self.mixture[0]
        return np.where((own == own[:, :1]).all(axis=1), own[:, 0], np.int32(-1))

    @property
    def _normals_of(self) -> NDArray[np.int32]:
        """The vertex whose normal each vertex uses, shape [vertex_count]."""
        return np.arange(len(self.particle), dtype=np.int32) if self.normal_of is None else self.normal_of


def _checked_weights(weights: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Return a surface's weights, checked, as a read-only array of this shape; None if vertices are particles."""
    if len(shape) == 1:
        if weights is not None:
            raise ValueError(
                f"weights are given, but particle has shape {shape}: weights must be None, or particle of the "
                "shape (vertex_count, k)"
            )
        return None
    if weights is None:
        raise ValueError(f"weights is None, but particle has shape {shape}: weights must be of that shape")
    found = checks.broadcast("weights", weights, shape)
    checks.within("weights", found, checks.FINITE)
    total = found.sum(axis=1)
    checks.every("the sum of weights", total, np.abs(total - 1) <= _SUM, f"1 to within {_SUM:g}")
    return found


def _widened(
    particle: NDArray[np.int32], weights: NDArray[np.float64], width: int
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Pad the particles of each vertex to `width` by repeating its first particle with weight 0."""
    more = width - particle.shape[1]
    repeated = np.repeat(particle[:, :1], more, axis=1)
    return np.hstack([particle, repeated]), np.hstack([weights, np.zeros((len(weights), more))])

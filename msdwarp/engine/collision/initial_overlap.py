"""Detect bodies that start inside others, too deep for contact to push them out."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import System, TouchingSurfaces, body_name
from ...kernels.filling import find_depths
from .contact_rules import ContactRules

DEEP = 0.45
"""Depth below the contact mesh, in spacings, beyond which a particle is inside: contact does not push it out."""
SAMPLES = 64
"""Maximal number of particles of a body that are tested."""


def initial_containment(system: System, surfaces: TouchingSurfaces, rules: ContactRules) -> str | None:
    """Return a warning about the body that starts deepest inside a solid body that it can touch, or None."""
    x, body = system.position, surfaces.body_of_particle
    bodies = len(surfaces.solid)
    if not surfaces.solid.any() or bodies < 2:
        return None
    low, high = np.full((bodies, 3), np.inf), np.full((bodies, 3), -np.inf)
    np.minimum.at(low, body, x)
    np.maximum.at(high, body, x)
    by_body = np.argsort(body, kind="stable")
    begin = np.searchsorted(body[by_body], np.arange(bodies + 1))
    vertices = np.einsum("vk,vkd->vd", surfaces.weight, x[surfaces.particle])
    owner = surfaces.body[surfaces.corner[:, 0]]
    deepest, worst = 0.0, (0, 0)
    for outer in np.flatnonzero(surfaces.solid):
        deep = DEEP * surfaces.spacing[outer]
        inner_low, inner_high = low[outer] + deep, high[outer] - deep
        near = ((low < inner_high) & (high > inner_low)).all(axis=1)
        near &= rules.between(np.arange(bodies), outer) >= 0
        near[outer] = False
        tried = [_sample(x, by_body[begin[k] : begin[k + 1]], inner_low, inner_high) for k in np.flatnonzero(near)]
        if not (particles := np.concatenate([*tried, np.zeros(0, dtype=int)])).size:
            continue
        depth = _depths(vertices, surfaces.corner[owner == outer], x[particles])
        depth[depth >= 0] += surfaces.radius[outer]  # the contact mesh is so far below the surface
        p = int(np.argmax(depth))
        if depth[p] > max(deep, deepest):
            deepest, worst = float(depth[p]), (int(particles[p]), int(outer))
    if not deepest:
        return None
    particle, outer = worst
    one, other = (body_name(system.groups, np.flatnonzero(body == k)) for k in (body[particle], outer))
    return (
        f"{one} starts inside {other}: particle {particle} is "
        f"{deepest:.3g} m deep in it, and contact does not push out what is that deep; move them apart, or have "
        "them ignore each other by Contact(groups=..., exclude=True)"
    )


def _sample(x: NDArray, particles: NDArray, low: NDArray, high: NDArray) -> NDArray[Any]:
    """Return at most SAMPLES of the particles in a box, evenly spread."""
    within = particles[((x[particles] > low) & (x[particles] < high)).all(axis=1)]
    return within[:: -(-len(within) // SAMPLES)] if len(within) else within


def _depths(vertices: NDArray, corner: NDArray, points: NDArray) -> NDArray[np.float64]:
    """Return the depths of points inside a closed surface [m], below 0 outside."""
    used, corner = np.unique(corner, return_inverse=True)
    origin = vertices[used].mean(axis=0)
    surface = wp.Mesh(
        points=wp.array(vertices[used] - origin, dtype=wp.vec3, device="cpu"),
        indices=wp.array(corner.ravel(), dtype=int, device="cpu"),
        support_winding_number=True,
    )
    depth = wp.zeros(len(points), dtype=float, device="cpu")
    reach = 2.0 * float(np.ptp(vertices[used], axis=0).sum())
    where = wp.array(points - origin, dtype=wp.vec3, device="cpu")
    wp.launch(find_depths, len(points), [surface.id, where, reach], [depth], device="cpu")
    return depth.numpy().astype(np.float64)

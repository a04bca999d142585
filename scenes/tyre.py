"""A rubber tyre rolls over a kerb: it flattens where it stands, and bulges as the kerb pushes into it."""

import numpy as np

from msdwarp import Box, Contact, Look, Material, Plane, Scene, from_mesh
from msdwarp.cli import scene_main
from msdwarp.textures import tyre_wall

RADIUS, TUBE, WIDTH, BLOCK = 0.28, 0.12, 0.14, 0.008
"""Distance of the tube's middle from the axle, half of its height, half of its width, height of its tread [m]."""


def mould(around: int = 208, across: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Return the points [m] and the triangles of a tyre about the z axis."""
    angle = 2 * np.pi * np.arange(around)[:, None] / around
    turn = 2 * np.pi * np.arange(across) / across
    outward, sideways = (np.sign(w) * np.abs(w) ** 0.6 for w in (np.cos(turn), np.sin(turn)))
    blocks = (np.cos(turn) > 0.45) * (np.cos(26 * angle + 6 * np.abs(np.sin(turn))) > -0.55)
    radius = RADIUS + TUBE * outward + BLOCK * blocks
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), WIDTH * sideways + 0 * angle], axis=-1)
    place = np.arange(around * across).reshape(around, across)
    beside, below = np.roll(place, -1, axis=1), np.roll(place, -1, axis=0)
    both = np.roll(below, -1, axis=1)
    triangles = np.concatenate([np.stack([place, beside, both], -1), np.stack([place, both, below], -1)])
    return points.reshape(-1, 3), triangles.reshape(-1, 3)


def build(*, across: int = 18, speed: float = 2.4, kerb: float = 0.08) -> Scene:
    """Roll a tyre of soft rubber, with a heavy rim, against a kerb.

    Parameters
    ----------
    across
        Cells across the tyre.
    speed
        Speed at which it comes [m/s].
    kerb
        Height of the kerb [m].
    """
    rubber = Material(density=300.0, youngs_modulus=8e4, damping_ratio=0.03, poissons_ratio=0.45)
    tyre = from_mesh(mould(), across=across, material=rubber)
    rim = np.hypot(tyre.position[:, 0], tyre.position[:, 1]) < RADIUS - TUBE / 2
    more = np.where(rim[tyre.connections].all(axis=1), 30.0, 1.0)  # heavier and stiffer: as short a step
    stiffness, damping = more * tyre.stiffness, more * tyre.damping
    tyre = tyre.replace(mass=np.where(rim, 30.0, 1.0) * tyre.mass, stiffness=stiffness, damping=damping)
    outer = RADIUS + TUBE + BLOCK
    tyre = tyre.rotate(np.pi / 2, axis=(1, 0, 0)).translate((-1.0, 0, outer + 0.003))
    tyre = tyre.with_velocity((speed, 0.0, 0.0)).spin((0.0, speed / outer, 0.0))
    pavement = Box((1.1, 0, kerb / 2), (2.2, 1.0, kerb), restitution=0.0, friction=0.9)
    look = Look(
        texture=tyre_wall("#26262a", "#ece8de", "#f2b230"), finish="rubber", obstacle="#d6d0c5", azimuth=-68
    )
    road = Plane(restitution=0.0, friction=0.9)
    contact = Contact(surface_colliders=True)
    return Scene(system=tyre, colliders=[road, pavement], contact=contact, duration=1.3, look=look)


if __name__ == "__main__":
    scene_main(build)

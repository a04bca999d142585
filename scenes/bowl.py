"""Scoops of ice cream fall into a soft waffle bowl, deform, and keep their new shape."""

import numpy as np

from msdwarp import Contact, Look, Plane, Scene, checks, from_mesh, icosphere
from msdwarp.cli import scene_main
from msdwarp.textures import scoop, waffle

WALL = ((0.0, 0.0), (0.24, 0.0), (0.34, 0.2), (0.46, 0.42), (0.39, 0.45), (0.27, 0.25), (0.18, 0.1), (0.0, 0.1))
"""Radius and height [m] along the wall of the bowl, from the middle of its base outside to that inside."""
FLAVOURS = (("#ffc3cb", "#9c2f45"), ("#fbf0d2", "#8a5a2b"), ("#7a4a2e", "#3f2415"), ("#c6e2a6", "#5d7d3c"))


def turned(profile: tuple[tuple[float, float], ...], around: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and the triangles of what a lathe makes of a profile that begins and ends at its axis."""
    radius, height = np.array(profile[1:-1]).T[:, :, None]
    angle = 2 * np.pi * np.arange(around) / around
    rings = np.stack([radius * np.cos(angle), radius * np.sin(angle), height + 0 * angle], axis=-1)
    here = np.arange(rings.size // 3).reshape(-1, around)
    beside, first, last = np.roll(here, -1, axis=1), len(here) * around, len(here) * around + 1
    quads = [here[:-1], beside[:-1], beside[1:], here[:-1], beside[1:], here[1:]]
    caps = [[beside[0], here[0], 0 * here[0] + first], [here[-1], beside[-1], 0 * here[0] + last]]
    triangles = np.concatenate([np.stack(one, axis=-1).reshape(-1, 3) for one in (quads, *caps)])
    return np.concatenate([rings.reshape(-1, 3), [(0, 0, profile[0][1]), (0, 0, profile[-1][1])]]), triangles


def build(*, count: int = 4, crisp: float = 250.0, stiffness: float = 60.0, yield_strain: float = 0.03) -> Scene:
    """Let scoops, 38 cm wide, fall into a bowl, 92 cm wide.

    Parameters
    ----------
    count
        Number of scoops. The first three lie side by side.
    crisp
        Spring constant of each connection of the bowl [N/m].
    stiffness
        Spring constant of each connection of a scoop [N/m].
    yield_strain
        Strain beyond which the ice cream deforms permanently.
    """
    checks.count("count", count, 1)
    bowl = from_mesh(turned(WALL, 20), spacing=0.08, mass=0.005, stiffness=crisp, damping=1.0).named("bowl")
    system = bowl.translate((0, 0, -bowl.position[:, 2].min()))
    looks = {"bowl": Look(texture=waffle("#e0a858", "#9a6428", counts=(10, 6), diagonal=True), gloss=0.15)}
    ice = from_mesh(icosphere(0.19, 2), across=5, mass=0.008, stiffness=stiffness, damping=0.4)
    ice = ice.replace(yield_strain=yield_strain, relaxation_time=0.3, largest_plastic_strain=0.5)
    for k in range(count):
        turn, out = 2 * np.pi * k / 3, 0.225 if k % 4 < 3 else 0.0
        place = (out * np.cos(turn), out * np.sin(turn), 0.62 + 0.42 * (k // 4 * 2 + k % 4 // 3))
        name = f"scoop {k + 1}"
        system = system + ice.rotate(0.9 * k).translate(place).named(name)
        looks[name] = Look(texture=scoop(*FLAVOURS[k % len(FLAVOURS)]), gloss=0.15)
    floor = Plane(restitution=0.0, friction=0.8)
    contact = Contact(friction=0.8, restitution=0.4, stiffness=28 * stiffness)  # at rest they overlap by < 4 mm
    look = Look(azimuth=-60, elevation=24)
    return Scene(system=system, colliders=[floor], contact=contact, duration=2.5, look=look, looks=looks)


if __name__ == "__main__":
    scene_main(build)

"""Bodies whose motion tests measure, with noise if they like, and fit again."""

import numpy as np

from msdwarp import Leapfrog, Plane, Scene, Simulation, TrackedPoints, box

STIFFNESS, DAMPING = 200.0, 0.2
"""The true ones, of small blocks of particles of 50 g [N/m, N s/m]."""
SUBSTEPS = 32
BOUNDS = {"stiffness": (50.0, 1000.0), "damping": (0.02, 1.0)}
METHOD = Leapfrog(damper_extrapolation=0.5)
HOW = {"substeps": SUBSTEPS, "bounds": BOUNDS, "device": "cpu"}


def block(stiffness=STIFFNESS, damping=DAMPING):
    return box((3, 3, 3), 0.1, mass=0.05, stiffness=stiffness, damping=damping)


def hung(*parameters) -> Scene:
    """Return a block that is held at its top and let go."""
    body = block(*parameters)
    return Scene(system=body.pin(body.position[:, 2] > body.position[:, 2].max() - 1e-6))


def dropped(*parameters) -> Scene:
    """Return a block that falls onto a floor with an edge first."""
    body = block(*parameters).rotate(35.0, (1.0, 0.5, 0.2)).translate((0.0, 0.0, 0.35))
    return Scene(system=body, colliders=[Plane(restitution=0.3)])


def tracked(scene: Scene, duration=1.0, *, noise=0.0, seed=0, **how) -> TrackedPoints:
    """Return where every third particle is in each frame, with normal noise [m]."""
    how = {"integrator": METHOD, "precision": "float64", "substeps": SUBSTEPS, "device": "cpu"} | how
    frames = list(Simulation.from_scene(scene, **how).frames(duration))
    followed = np.arange(0, scene.system.particle_count, 3)
    position = np.array([frame.position[followed] for frame in frames])
    position += noise * np.random.default_rng(seed).normal(size=position.shape)
    time = np.repeat([frame.time for frame in frames], len(followed))
    return TrackedPoints(time, np.tile(followed, len(frames)), position.reshape(-1, scene.system.dim))


def rows(points: TrackedPoints) -> np.ndarray:
    """Return tracked points as a file has them: time, id, x, y, z."""
    return np.column_stack([points.time, points.particle, points.position])


def csv_of(points: TrackedPoints) -> str:
    lines = [",".join(f"{number:.12g}" for number in row) for row in rows(points)]
    return "\n".join(["time,id,x,y,z", *lines]) + "\n"

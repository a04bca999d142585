"""A cloth that is folded on itself again and again: no triangle of it goes through another one."""

import numpy as np
import pytest

import msdwarp as msd
from benchmarks.accuracy.crossings import crossings

pytest.importorskip("ipctk")
PERIOD = 1.5
"""How long it takes to squeeze the cloth once, and to let go again [s]."""


def crossing_frames(times: int, contact: msd.Contact | None, bending: float = 4e-3) -> list[int]:
    """Squeeze a cloth so many times; return the frames in which triangles of it go through each other."""
    spacing = 0.05
    cloth = msd.sheet((13, 7), spacing, mass=0.002, stiffness=60.0, damping=0.05, bending=bending)
    cloth = cloth.translate(tuple(np.array([0, 0, 0.01]) - cloth.position.min(axis=0)))
    along = cloth.position[:, 0]
    length = np.ptp(along)

    def squeeze(t):
        """Bring one end to within a third of the length of the other, and back."""
        return 0.7 * length * (np.cos(2 * np.pi * np.asarray(t)[..., None] / PERIOD) - 1) / 2 * np.array([1, 0, 0])

    scene = msd.Scene(
        system=cloth.pin(along < 0.5 * spacing),
        colliders=[msd.Plane(restitution=0.0, friction=0.5)],
        loads=[msd.PrescribedMotion(np.flatnonzero(along > length - 0.5 * spacing), squeeze)],
        contact=contact,
    )
    simulation = msd.Simulation.from_scene(scene, device="cpu")
    return crossings(simulation, round(times * PERIOD * simulation.fps))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("times", "bending", "thickness"),
    [(4, 4e-3, 0.02), (2, 1e-3, None)],
    ids=["four times", "softer, and of its own thickness"],
)
def test_a_cloth_folded_on_itself_again_and_again_does_not_cross_itself(times, bending, thickness):
    # Its end moves at 0.9 m/s at most. At 1.3 m/s it collapses into creases sharper than its triangles, which
    # cross (docs/contact.md). More often, and at other speeds, benchmarks/accuracy/folding.py folds it.
    contact = msd.Contact(friction=0.3, restitution=0.1, self_contact=True, thickness=thickness)
    assert crossing_frames(times, contact, bending) == []


@pytest.mark.slow
def test_without_contact_the_same_folds_go_through_each_other():
    assert crossing_frames(1, None)

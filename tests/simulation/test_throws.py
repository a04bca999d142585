"""Throws of a die, each a world of an ensemble: fair with a fair die, not with a loaded one."""

import numpy as np
import pytest

from msdwarp import Contact, Ensemble, Plane, box

THROWS = 180
EDGE = 0.15
DIE = box((3, 3, 3), EDGE, mass=0.02, stiffness=4000.0, damping=3.0)
FACES = [np.isclose(side * DIE.position[:, axis], EDGE) for axis in range(3) for side in (-1, 1)]
"""The particles of each face; the centre of the die lies in the origin."""


def throws(seed: int) -> dict[str, np.ndarray]:
    """Return starts of all throws: each rotation as likely as any other, and spun."""
    random = np.random.default_rng(seed)
    turns = np.linalg.qr(random.normal(size=(THROWS, 3, 3)))[0]
    turns *= np.sign(np.linalg.det(turns))[:, None, None]
    place = DIE.position @ np.swapaxes(turns, 1, 2)
    spin = 9.0 * random.normal(size=(THROWS, 1, 3))
    velocity = np.cross(spin, place) + np.array([2.0, 0.0, 0.0])
    return {"position": place + np.array([0.0, 0.0, 0.6]), "velocity": velocity}


def upper_face(position: np.ndarray) -> np.ndarray:
    """Return which face lies up in each world."""
    heights = [position[:, face, 2].mean(axis=1) for face in FACES]
    return np.argmax(heights, axis=0)


def statistic(die) -> float:
    """Return Pearson's chi square of the faces that lie up, against a fair die's."""
    ensemble = Ensemble(die, THROWS, colliders=[Plane(friction=0.4, restitution=0.3)], device="cpu", **throws(4))
    ensemble.step(180)
    assert (ensemble.status == "running").all()
    count = np.bincount(upper_face(ensemble.frame().position), minlength=6)
    return float(((count - THROWS / 6) ** 2 / (THROWS / 6)).sum())


@pytest.mark.slow
def test_a_fair_die_is_fair_and_a_loaded_one_is_not():
    from scipy.stats import chi2  # which takes a second

    assert DIE.position.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    limit = chi2.ppf(0.999, df=5)  # a fair die exceeds it once in a thousand times; the throws are always the same
    assert statistic(DIE) < limit
    loaded = DIE.replace(mass=np.where(FACES[0], 0.2, 0.02))  # ten times as heavy: that face comes to lie below
    assert statistic(loaded) > 10 * limit


@pytest.mark.slow
def test_dice_that_knock_each_other_are_fair_but_for_a_loaded_one():
    from scipy.stats import chisquare

    """Two small dice are thrown at each other: symmetry makes a fair one fair, whatever it meets on its way."""
    worlds, edge = 90, 0.1
    die = box((2, 2, 2), 2 * edge, mass=0.05, stiffness=2000.0, damping=3.0)
    random = np.random.default_rng(2)
    turns = np.linalg.qr(random.normal(size=(worlds, 2, 3, 3)))[0]
    turns *= np.sign(np.linalg.det(turns))[..., None, None]
    turned = die.position @ np.swapaxes(turns, 2, 3)
    side = np.array([-1.0, 1.0])[:, None, None] * (1.0, 0.0, 0.0)
    place = turned + 0.25 * side + (0.0, 0.0, 0.5)
    velocity = np.cross(9.0 * random.normal(size=(worlds, 2, 1, 3)), turned) - 1.5 * side
    faces = [np.isclose(end * die.position[:, axis], edge) for axis in range(3) for end in (-1, 1)]
    heavy = np.where(faces[0], 0.5, 0.05)
    pair = die.translate((-0.25, 0.0, 0.5)) + die.translate((0.25, 0.0, 0.5)).replace(mass=heavy)
    ensemble = Ensemble(
        pair,
        worlds,
        position=place.reshape(worlds, -1, 3),
        velocity=velocity.reshape(worlds, -1, 3),
        colliders=[Plane(friction=0.4, restitution=0.3)],
        contact=Contact(friction=0.3, restitution=0.5),
        device="cpu",
    )
    ensemble.step(90)
    assert (ensemble.status == "running").all()
    height = ensemble.frame().position[:, :, 2].reshape(worlds, 2, 8)
    up = np.argmax([height[..., face].mean(axis=2) for face in faces], axis=0)
    fair, loaded = (chisquare(np.bincount(shown, minlength=6)).pvalue for shown in up.T)
    assert fair > 1e-3  # a fair die falls below once in a thousand times; the throws are always the same
    assert loaded < 1e-9
